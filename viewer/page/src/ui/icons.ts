/** Icons, drawn with strokes in a square of 24 units. */

const PATHS = {
  orbit: "M12 15a3 3 0 1 0 0-6 3 3 0 0 0 0 6M3.5 9.5C5 6.5 8.3 4.5 12 4.5c3.2 0 6 1.5 7.7 3.800M20.5 14.5c-1.5 3-4.8 5-8.5 5-3.2 0-6-1.5-7.7-3.800M20 4v4.5h-4.5M4 20v-4.5h4.5",
  cab: "M5 20V8l4-4h8a2 2 0 0 1 2 2v14zM5 12h14M10 4v8M8 16h4",
  top: "M4 4h16v16H4zM12 8v8M8 12h8",
  bucket: "M6 4l3 5M5 9h11l3 4c0 5-4 7-8 7-5 0-7-5-6-11M16 20l1.5 2M12 20.5l1 2",
  view: "M2.5 12S6 5.5 12 5.5 21.5 12 21.5 12 18 18.5 12 18.5 2.5 12 2.5 12zM12 15a3 3 0 1 0 0-6 3 3 0 0 0 0 6z",
  machine: "M3 17h12a2 2 0 0 1 0 4H5a2 2 0 0 1-2-4zM5 17v-6h6l1 6M11 12l4-7 5 4M20 9l1 5-4 1",
  pause: "M8 5v14M16 5v14",
  play: "M7 4.5v15l12-7.5z",
  step: "M6 5v14l9-7zM18 5v14",
  reset: "M4 12a8 8 0 1 0 2.5-5.800M4 4v4.5h4.5",
  record: "M12 18a6 6 0 1 0 0-12 6 6 0 0 0 0 12z",
  bags: "M3 7l2-3h6l2 3h8v13H3zM3 11h18",
  help: "M12 21a9 9 0 1 0 0-18 9 9 0 0 0 0 18zM9.5 9.5a2.5 2.5 0 1 1 3.5 2.300c-.7.3-1 .9-1 1.700v.5M12 17v.2",
  close: "M6 6l12 12M18 6L6 18",
  chevron: "M7 10l5 5 5-5",
  gamepad: "M7 8h10a5 5 0 0 1 4.5 6.5C21 18 19 18.5 17.5 17L15.5 15h-7l-2 2C5 18.5 3 18 2.5 14.5A5 5 0 0 1 7 8zM8 10.5v3M6.5 12h3M15.5 11v.1M17.5 13v.1",
  touch: "M9 11V5.5a1.5 1.5 0 0 1 3 0V11l5 1a2.5 2.5 0 0 1 2 2.700L18 21H10l-4-5.5c-1-1.5.8-2.8 2-1.700l1 1zM6 6a4.5 4.5 0 0 1 9 0",
  keyboard: "M3 6h18v12H3zM7 10v.1M11 10v.1M15 10v.1M18 10v.1M7 14h10",
  back: "M5 12h14M11 6l-6 6 6 6",
} as const;

export type IconName = keyof typeof PATHS;

const SVG = "http://www.w3.org/2000/svg";

/** Make an icon; it is decoration, the accessible name is that of its button. */
export function makeIcon(name: IconName): SVGSVGElement {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("class", `icon icon-${name}`);
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS(SVG, "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
