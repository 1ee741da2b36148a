/** Colour scales of the terrain, on the GPU and as legends. */

import { DataTexture, LinearFilter, RGBAFormat, SRGBColorSpace, UnsignedByteType } from "three";
import type { Rgb, SiteMessage } from "../protocol";
import type { Coloring, Legend } from "../ui/interfaces";

export const COLORINGS: readonly Coloring[] = [
  { id: "natural", label: "Natural" },
  { id: "height", label: "Height" },
  { id: "cut_fill", label: "Cut and fill" },
  { id: "soil", label: "Soil" },
  { id: "moisture", label: "Moisture" },
  { id: "loose_depth", label: "Loose depth" },
];

interface Scale {
  title: string;
  unit: string;
  colors: readonly Rgb[];
}

const HEIGHT_COLORS: readonly Rgb[] = [
  [0.2, 0.16, 0.4],
  [0.17, 0.38, 0.55],
  [0.16, 0.56, 0.55],
  [0.4, 0.71, 0.4],
  [0.87, 0.83, 0.35],
  [0.93, 0.55, 0.26],
];
const DIVERGING_COLORS: readonly Rgb[] = [
  [0.6, 0.09, 0.13],
  [0.88, 0.42, 0.31],
  [0.96, 0.78, 0.67],
  [0.91, 0.91, 0.88],
  [0.68, 0.82, 0.9],
  [0.33, 0.58, 0.78],
  [0.1, 0.29, 0.53],
];
const MOISTURE_COLORS: readonly Rgb[] = [
  [0.87, 0.76, 0.55],
  [0.68, 0.69, 0.55],
  [0.38, 0.59, 0.63],
  [0.15, 0.4, 0.62],
  [0.08, 0.2, 0.43],
];
const LOOSE_COLORS: readonly Rgb[] = [
  [0.8, 0.8, 0.77],
  [0.95, 0.83, 0.5],
  [0.96, 0.58, 0.22],
  [0.78, 0.27, 0.17],
  [0.42, 0.07, 0.2],
];

const SCALES: Record<string, Scale> = {
  height: { title: "Height", unit: "m", colors: HEIGHT_COLORS },
  cut_fill: { title: "Cut (red) and fill (blue)", unit: "m", colors: DIVERGING_COLORS },
  moisture: { title: "Moisture", unit: "%", colors: MOISTURE_COLORS },
  loose_depth: { title: "Loose depth", unit: "m", colors: LOOSE_COLORS },
};

/** Number by which the shader knows a colouring. */
export function coloringIndex(id: string): number {
  return Math.max(
    COLORINGS.findIndex((coloring) => coloring.id === id),
    0,
  );
}

/** Values at both ends of a colour scale. */
export interface ScaleRange {
  low: number;
  high: number;
}

/** Return the range of a colouring for a site whose elevations are in `heights` [m]. */
export function scaleRange(id: string, heights: ScaleRange): ScaleRange {
  switch (id) {
    case "height":
      return heights;
    case "cut_fill":
      return { low: -1.5, high: 1.5 };
    case "moisture":
      return { low: 0, high: 100 };
    case "loose_depth":
      return { low: 0, high: 1 };
    default:
      return { low: 0, high: 1 };
  }
}

/** Return the legend of a colouring; null for natural colours. */
export function legendOf(id: string, range: ScaleRange, site: SiteMessage | null): Legend | null {
  if (id === "soil") {
    const items = (site?.soils ?? []).map(({ name, color }) => ({ label: name || "unnamed soil", color }));
    return { kind: "swatches", title: "Soil", items };
  }
  const scale = SCALES[id];
  if (!scale) return null;
  const last = scale.colors.length - 1;
  const stops = scale.colors.map((color, i) => ({
    value: range.low + (i / last) * (range.high - range.low),
    color,
  }));
  const title = id === "cut_fill" && site?.design ? "Above (blue) and below (red) design" : scale.title;
  return { kind: "gradient", title, unit: scale.unit, stops };
}

const TEXELS = 64;

/** Return a texture with the colour scale of each colouring in the row of its index. */
export function scaleTexture(): DataTexture {
  const data = new Uint8Array(4 * TEXELS * COLORINGS.length).fill(255);
  COLORINGS.forEach(({ id }, row) => {
    const scale = SCALES[id];
    if (!scale) return;
    for (let i = 0; i < TEXELS; i++) {
      const position = (i / (TEXELS - 1)) * (scale.colors.length - 1);
      const left = Math.min(Math.floor(position), scale.colors.length - 2);
      for (let k = 0; k < 3; k++) {
        const from = scale.colors[left]![k]!;
        const to = scale.colors[left + 1]![k]!;
        data[4 * (row * TEXELS + i) + k] = Math.round(255 * (from + (position - left) * (to - from)));
      }
    }
  });
  const texture = new DataTexture(data, TEXELS, COLORINGS.length, RGBAFormat, UnsignedByteType);
  texture.colorSpace = SRGBColorSpace;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}
