// Elements of the page, and numbers as it writes them.

export function find<T extends HTMLElement = HTMLElement>(id: string): T {
  return document.getElementById(id) as T;
}

/** A new element; what is put into it as a string is text, whatever it says. */
export function element(tag: string, attributes: Record<string, string> = {}, ...inner: (Node | string)[]): HTMLElement {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...inner);
  return made;
}

export const digits = (value: number, count = 3): string => (Number.isFinite(value) ? String(Number(value.toPrecision(count))) : "-");
export const length = (metres: number): string => (Math.abs(metres) < 0.1 ? `${digits(metres * 1e3)} mm` : `${digits(metres)} m`);

export function gauge(id: string, value: string, more?: string): void {
  find(id).replaceChildren(value, ...(more ? [element("small", {}, more)] : []));
}
