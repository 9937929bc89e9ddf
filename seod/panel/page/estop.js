// The e-stop: by click or by Escape, wherever one is on the page. It goes as the button is pressed, not as it is let go,
// over the open connection; what is not answered soon goes again, over HTTP as well.

import { at } from "/static/common.js";

const AGAIN_MS = 250;

export function armEstop(wire, about, told) {
  const button = at("estop");
  let number = 0;
  const press = async () => {
    const mine = ++number;
    button.classList.add("done");
    const sent = wire.ask("estop").then(() => true);
    sent.catch(() => {}); // told below, if it comes in time
    const late = new Promise((resolve) => { setTimeout(() => resolve(false), AGAIN_MS); });
    try {
      if (!(await Promise.race([sent, late])) && mine === number) throw new Error("no answer yet");
      told("");
    } catch (error) {
      try {
        const answer = await fetch("/estop", { method: "POST", headers: { "x-seod-csrf": about.csrf }, keepalive: true });
        const said = await answer.json();
        told(answer.ok ? "" : `E-stop: ${said.error}. Use the emergency stop of the machine.`);
      } catch (again) { told(`E-stop: ${error.message}. Use the emergency stop of the machine.`); }
    } finally { setTimeout(() => button.classList.remove("done"), 600); }
  };
  button.addEventListener("pointerdown", (event) => { if (event.button === 0) press(); });
  button.addEventListener("click", (event) => { if (event.detail === 0) press(); }); // by key or by a screen reader
  document.addEventListener("keydown", (event) => {
    if (event.key === "Escape" && !event.repeat) { event.preventDefault(); press(); }
  }, true);
}
