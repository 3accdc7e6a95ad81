"""Pages that a browser has open."""


class Opened:
    """A page that is open, and what it complained of or asked for."""

    heard = ("error", "warning")
    """Messages on the console that are complaints."""

    def __init__(self, browser, url, ready, wide=1200, high=800, script=None, **context):
        self.context = browser.new_context(viewport={"width": wide, "height": high}, **context)
        self.page = self.context.new_page()
        self.complaints, self.requests, self.dialogs = [], [], []
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._hear)
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.page.on("dialog", lambda dialog: self.dialogs.append(dialog.message))
        if script:
            self.page.add_init_script(script)
        self.page.goto(url)
        self.page.wait_for_selector(ready, timeout=60_000)

    def _hear(self, message):
        if message.type in self.heard:
            self.complaints.append(message.text)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.context.close()

    def ask(self, script, *arguments):
        return self.page.evaluate(script, *arguments)
