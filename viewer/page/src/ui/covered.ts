/** Find how much of the scene panels cover in small windows, where they are as wide as the window. */

/** Windows that count; in others panels leave the middle of the scene free. */
const SMALL = "(width <= 620px), (height <= 480px)";

/** Share of the width of the window from which on a panel counts. */
const WIDE = 0.5;

/**
 * Report the heights [px] that panels cover at the top and at the bottom edge of the window, now and when they change.
 *
 * @param top panels that are at the top edge while they are wide.
 * @param bottom panel at the bottom edge.
 */
export function watchCovered(
  top: readonly HTMLElement[],
  bottom: HTMLElement,
  changed: (top: number, bottom: number) => void,
): void {
  const observer = new ResizeObserver(() => {
    if (!matchMedia(SMALL).matches) return changed(0, 0);
    const ends = top.map((element) => element.getBoundingClientRect());
    const wide = ends.filter(({ width }) => width > WIDE * innerWidth);
    changed(Math.max(0, ...wide.map((end) => end.bottom)), innerHeight - bottom.getBoundingClientRect().top);
  });
  for (const element of [...top, bottom]) observer.observe(element);
}
