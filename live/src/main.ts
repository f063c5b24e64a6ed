// Starts the page, or says why it does not.
import { find } from "./elements";
import { loadEngine } from "./engine";
import { Page } from "./page";
import { pageData } from "./page_data";
import { View } from "./scene";

function viewOn(place: HTMLElement): View | null {
  try {
    return new View(place);
  } catch {
    return null;
  }
}

async function start(): Promise<void> {
  if (typeof WebAssembly === "undefined" || typeof DecompressionStream === "undefined") {
    find("message").textContent = "This browser is too old for this page: it takes WebAssembly and DecompressionStream.";
    return;
  }
  const [page, engine] = await Promise.all([pageData(), loadEngine()]);
  const live = new Page(page, engine, viewOn(find("view")));
  await live.start();
  Object.assign(window, { live });
  document.body.dataset.ready = String(Math.round(performance.now()));
}

start().catch((error: unknown) => {
  const message = find("message");
  message.classList.add("bad");
  message.textContent = `The page does not start: ${error instanceof Error ? error.message : String(error)}`;
});
