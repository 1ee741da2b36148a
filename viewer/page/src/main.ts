/** Composition of the page. */

import { Object3D, Vector3 } from "three";
import { takeAccessToken } from "./access_token";
import { Connection, type Source } from "./connection";
import { drawsInSoftware } from "./graphics";
import { servePictures } from "./renderer";
import { Stage } from "./stage";
import { installTestInterface } from "./test_interface";
import type { CameraName, QualityName } from "./ui/interfaces";
import { createUserInterface } from "./ui/user_interface";
import { createViewPort } from "./view_port";
import { WorldState } from "./world_state";

Object3D.DEFAULT_UP = new Vector3(0, 0, 1);

/** Longest time that the scene waits for the login to be sent [ms]. */
const LOGIN_MS = 3000;

const parameters = new URLSearchParams(location.search);
const bag = parameters.get("bag");
const isRenderer = parameters.has("renderer"); // pictures are drawn well, however long it takes
const source: Source = bag ? { bag } : "live";

const connection = new Connection({
  url: `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/stream`,
  token: takeAccessToken(),
  source,
});
const world = new WorldState(connection);
connection.open();
await connection.sendsLogin(LOGIN_MS); // the server answers while the scene is made; messages are received only after it
const canvas = document.getElementById("scene") as HTMLCanvasElement;
const stage = new Stage(canvas, world, {
  quality: oneOf<QualityName>(parameters.get("quality"), ["low", "medium", "high"]),
  camera: oneOf<CameraName>(parameters.get("camera"), ["orbit", "cab", "top", "bucket"]) ?? "orbit",
  isSoftware: !isRenderer && drawsInSoftware(),
});
connection.on("hello", () => stage.siteChanged());
connection.on("site", () => stage.siteChanged());
installTestInterface(connection, world, stage);
if (isRenderer) {
  servePictures(connection, stage);
} else {
  const root = document.getElementById("ui") as HTMLElement;
  createUserInterface({ connection, world, view: createViewPort(stage), root });
  stage.start();
}

/** Return a value if it is one of those named, or else null. */
function oneOf<T extends string>(value: string | null, names: readonly T[]): T | null {
  return names.find((name) => name === value) ?? null;
}
