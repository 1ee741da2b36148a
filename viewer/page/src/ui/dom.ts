/** Small helpers to make and update elements. */

export type Child = Node | string | null;

/** Attributes of an element; `true` is an attribute without a value, `false` and undefined none. */
export type Attributes = Readonly<Record<string, string | number | boolean | undefined>>;

/** Make an element with attributes and children. */
export function make<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: readonly Child[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) setAttribute(element, name, value);
  for (const child of children) if (child !== null) element.append(child);
  return element;
}

/** Set an attribute if it differs; `true` is an attribute without a value, `false` and undefined remove it. */
export function setAttribute(element: Element, name: string, value: string | number | boolean | undefined): void {
  if (value === false || value === undefined) {
    if (element.hasAttribute(name)) element.removeAttribute(name);
    return;
  }
  const text = value === true ? "" : String(value);
  if (element.getAttribute(name) !== text) element.setAttribute(name, text);
}

/** Set the text of an element if it differs, so that unchanged numbers cost no layout. */
export function setText(element: HTMLElement, text: string): void {
  const node = element.firstChild;
  if (node instanceof Text && element.childNodes.length === 1) {
    if (node.data !== text) node.data = text;
  } else if (node !== null || text !== "") {
    element.textContent = text;
  }
}

/** Show or hide an element. */
export function setShown(element: HTMLElement, isShown: boolean): void {
  if (element.hidden === isShown) element.hidden = !isShown;
}

/** Set a custom property of the style if it differs. */
export function setProperty(element: HTMLElement, name: string, value: string): void {
  if (element.style.getPropertyValue(name) !== value) element.style.setProperty(name, value);
}

export interface ButtonOptions {
  testId: string;
  /** Accessible name; the tooltip if `title` is not given. */
  label: string;
  title?: string;
  class?: string;
  onClick: (event: MouseEvent) => void;
}

/** Make a button. */
export function makeButton(options: ButtonOptions, ...children: readonly Child[]): HTMLButtonElement {
  const { testId, label, onClick } = options;
  const button = make(
    "button",
    {
      type: "button",
      class: options.class ?? "button",
      title: options.title ?? label,
      "aria-label": label,
      "data-testid": testId,
    },
    ...children,
  );
  button.addEventListener("click", onClick);
  return button;
}
