// Films of the gallery play when the pointer is over them, or when they have the focus.
"use strict";

function hold(film) {
  const still = document.createElement("canvas");
  still.width = film.naturalWidth;
  still.height = film.naturalHeight;
  still.tabIndex = 0;
  still.setAttribute("role", "img");
  still.setAttribute("aria-label", `${film.alt} A film: point at it to play.`);
  still.getContext("2d").drawImage(film, 0, 0); // its first picture
  film.after(still);
  const card = film.closest(".picture");
  const play = (on) => {
    film.hidden = !on;
    still.hidden = on;
  };
  play(false);
  for (const name of ["pointerenter", "focusin"]) card.addEventListener(name, () => play(true));
  for (const name of ["pointerleave", "focusout"]) card.addEventListener(name, () => play(false));
}

addEventListener("load", () => {
  for (const film of document.querySelectorAll('.picture img[src$=".gif"]')) hold(film);
});
