/** Mouse, wheel and touch on the canvas: one pointer drags, the secondary button or two fingers move and zoom. */

export interface PointerTarget {
  /** Movements are fractions of the height of the canvas. */
  drag(dx: number, dy: number): void;
  pan(dx: number, dy: number): void;
  zoom(factor: number): void;
}

interface Pointer {
  x: number;
  y: number;
}

export function listenToPointers(canvas: HTMLCanvasElement, target: PointerTarget): void {
  const pointers = new Map<number, Pointer>();
  let isPanning = false;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    isPanning = event.button !== 0 || event.shiftKey;
  });
  canvas.addEventListener("pointermove", (event) => {
    const pointer = pointers.get(event.pointerId);
    if (!pointer) return;
    const height = Math.max(canvas.clientHeight, 1);
    const dx = (event.clientX - pointer.x) / height;
    const dy = (event.clientY - pointer.y) / height;
    if (pointers.size === 2) {
      let other: Pointer = pointer;
      for (const each of pointers.values()) if (each !== pointer) other = each;
      const before = Math.hypot(pointer.x - other.x, pointer.y - other.y);
      const after = Math.hypot(event.clientX - other.x, event.clientY - other.y);
      if (before > 0 && after > 0) target.zoom(before / after);
      target.pan(dx / 2, dy / 2);
    } else if (isPanning) {
      target.pan(dx, dy);
    } else {
      target.drag(dx, dy);
    }
    pointer.x = event.clientX;
    pointer.y = event.clientY;
  });
  const release = (event: PointerEvent): void => {
    pointers.delete(event.pointerId);
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaY * (event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 30 : 1);
      target.zoom(Math.exp(Math.max(-240, Math.min(240, pixels)) * 0.0012));
    },
    { passive: false },
  );
}
