/**
 * Pictures for films and camera topics. A page that is opened with `?renderer=1` has no user interface and draws only
 * what the server requests, each time the newest state and without any extrapolation between states.
 */

import { Quaternion } from "three";
import { pictureView } from "./cameras/picture_view";
import type { CameraView } from "./cameras/view";
import type { Connection } from "./connection";
import { meshesDecoded } from "./machines/visuals";
import type { PictureMessage, RenderMessage } from "./protocol";
import type { Stage } from "./stage";

/** Longest simulated time between two pictures over which smoke and dust move on [s]; more is a jump. */
const MAX_ELAPSED = 5;

const JPEG_QUALITY = 0.92;

/** Half a turn about x: from the camera's frame (y up, looks along -z) to the optical frame (y down, z forward). */
const OPTICAL = new Quaternion(1, 0, 0, 0);

/** Draw the pictures that the server requests, one after the other. */
export function servePictures(connection: Connection, stage: Stage): void {
  reportFailures(connection);
  const painter = new PicturePainter(stage);
  let last: Promise<unknown> = Promise.resolve();
  connection.on("frame", (message) => {
    message.paused = true; // nothing moves until the next frame
  });
  connection.on("render", (message) => {
    last = last.then(async () => {
      connection.sendPicture(await painter.paint(message));
    });
    last.catch((error: unknown) => connection.send({ type: "failure", message: String(error) }));
  });
}

/** Report errors of the page to the server, which ends the film with them. */
function reportFailures(connection: Connection): void {
  const report = (message: string): void => void connection.send({ type: "failure", message });
  window.addEventListener("error", (event) => report(event.message));
  window.addEventListener("unhandledrejection", (event) => report(String(event.reason)));
  document.getElementById("scene")?.addEventListener("webglcontextlost", () => report("the graphics context was lost"));
}

class PicturePainter {
  private time: number | null = null;
  private camera = "";
  private view: CameraView | null = null;

  constructor(private readonly stage: Stage) {}

  async paint(message: RenderMessage): Promise<PictureMessage> {
    const { stage } = this;
    stage.machines.update(performance.now(), Infinity); // makes new machines
    await meshesDecoded();
    const elapsed = this.elapsed(message.time);
    stage.advance(elapsed);
    let data: Uint8Array = new Uint8Array();
    if (message.format !== "none") {
      this.resize(message.width, message.height);
      this.select(message);
      stage.drawFrame(elapsed);
      data = await this.read(message.format);
    }
    const { camera } = stage.cameras;
    const { x, y, z, w } = camera.quaternion.clone().multiply(OPTICAL);
    return {
      type: "picture",
      id: message.id,
      width: message.width,
      height: message.height,
      data,
      position: camera.position.toArray(),
      rotation: [x, y, z, w],
      fov: camera.fov,
    };
  }

  /** Return the simulated time since the last picture [s]; 0 after a jump. */
  private elapsed(time: number): number {
    const elapsed = this.time === null ? 0 : time - this.time;
    this.time = time;
    return elapsed >= 0 && elapsed <= MAX_ELAPSED ? elapsed : 0;
  }

  private resize(width: number, height: number): void {
    const { canvas, renderer } = this.stage;
    if (canvas.width === width && canvas.height === height) return;
    canvas.style.width = `${width}px`;
    canvas.style.height = `${height}px`;
    renderer.setPixelRatio(1);
    renderer.setSize(width, height, false);
  }

  /** Use the camera of a message; a view that follows a machine continues from picture to picture. */
  private select(message: RenderMessage): void {
    const { camera } = message;
    this.stage.followed = "machine" in camera ? camera.machine : "";
    const key = JSON.stringify(camera);
    if (key === this.camera && this.view) return;
    this.camera = key;
    this.view = pictureView(camera);
    this.stage.cameras.use(this.view);
  }

  /** Read the drawn picture; the canvas holds it until this task ends. */
  private async read(format: "rgb" | "png" | "jpeg"): Promise<Uint8Array> {
    const { canvas, renderer } = this.stage;
    if (format === "rgb") return readRgb(renderer.getContext() as WebGL2RenderingContext);
    const blob = await new Promise<Blob | null>((resolve) => {
      canvas.toBlob(resolve, `image/${format}`, JPEG_QUALITY);
    });
    if (!blob) throw new Error(`the browser cannot encode ${format}`);
    return new Uint8Array(await blob.arrayBuffer());
  }
}

/** Return the pixels of the drawing buffer: red, green, blue, row by row from the top. */
function readRgb(gl: WebGL2RenderingContext): Uint8Array {
  const { drawingBufferWidth: width, drawingBufferHeight: height } = gl;
  const rgba = new Uint8Array(4 * width * height);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  const rgb = new Uint8Array(3 * width * height);
  for (let row = 0, to = 0; row < height; row++) {
    let from = 4 * width * (height - 1 - row);
    for (let col = 0; col < width; col++, from += 4) {
      rgb[to++] = rgba[from]!;
      rgb[to++] = rgba[from + 1]!;
      rgb[to++] = rgba[from + 2]!;
    }
  }
  return rgb;
}
