// Opening of a page by the last class of its scripts.

const told = (id) => JSON.parse(document.getElementById(id).textContent);
globalThis.crinoid = new (typeof Live === "undefined" ? Page : Live)({ ...told("table"), document: told("document") });
globalThis.crinoid.start();
