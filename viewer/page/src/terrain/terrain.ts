/** The ground: its layers, its levels of detail, its material and its colouring. */

import {
  Group,
  Mesh,
  type BufferGeometry,
  type Camera,
  type MeshStandardMaterial,
  type Texture,
  type Vector3,
  type WebGLRenderer,
} from "three";
import type { SiteMessage } from "../protocol";
import type { Legend } from "../ui/interfaces";
import type { TerrainState } from "../world_state";
import { coloringIndex, legendOf, scaleRange, type ScaleRange } from "./colorings";
import { DetailTextures } from "./detail_textures";
import { readHeights } from "./height_reader";
import { HeightTextures } from "./height_textures";
import { heightUniforms } from "./height_glsl";
import { Patches } from "./patches";
import { MAX_SOILS, SurfaceMaps } from "./surface_maps";
import { BorderStakes } from "./border_stakes";
import { Tufts } from "./tufts";
import { MAX_CONTACTS, setPlain, terrainDepthMaterial, terrainMaterial, terrainUniforms, type TerrainUniforms } from "./terrain_material";

/** Vertical distance of the contour lines of the colouring by height [m]; each fifth one is stronger. */
const CONTOUR_STEP = 0.25;

export interface TerrainDetail {
  /** Largest number of vertices for each cell along a side; they are at least 0.09 m apart if there are several. */
  subdivision: number;
  /** Distance from the camera to which the finest level reaches [m], at least. */
  range: number;
  /** Distance to which tufts of grass grow [m]; 0 for none. */
  tuftReach: number;
  /** Whether the ground is drawn with few texture reads. */
  isPlain: boolean;
}

export class Terrain {
  readonly group = new Group();
  /** Uniforms of the height texture, for other materials on the ground. */
  readonly heightUniforms = heightUniforms();
  readonly uniforms: TerrainUniforms;
  private readonly detail: DetailTextures;
  private readonly patches = new Patches();
  private readonly tufts: Tufts;
  private readonly stakes = new BorderStakes(this.heightUniforms);
  private readonly drawn: Mesh<BufferGeometry, MeshStandardMaterial>;
  private readonly casting: Mesh;
  private textures: HeightTextures | null = null;
  private maps: SurfaceMaps | null = null;
  private site: SiteMessage | null = null;
  private heights: ScaleRange = { low: 0, high: 1 };
  private coloringId = "natural";
  private hasDetail = false;
  private seenTiles = 0;

  /** @param isSoftware draw without a graphics card: detail textures with fewer texels and samples. */
  constructor(
    private detailLevel: TerrainDetail,
    isSoftware: boolean,
  ) {
    this.detail = isSoftware ? new DetailTextures(256, 1) : new DetailTextures(512, 8);
    this.uniforms = terrainUniforms(this.heightUniforms, this.detail);
    this.tufts = new Tufts(this.uniforms);
    this.drawn = new Mesh(this.patches.drawn.geometry, terrainMaterial(this.uniforms));
    this.drawn.receiveShadow = true;
    this.drawn.onBeforeRender = () => {
      this.patches.drawn.geometry.instanceCount = this.patches.drawn.count;
    };
    // A mesh of its own casts the shadows, because they need other patches than the view. It draws nothing else.
    this.casting = new Mesh(this.patches.casting.geometry, this.drawn.material);
    this.casting.customDepthMaterial = terrainDepthMaterial(this.uniforms);
    this.casting.castShadow = true;
    this.casting.onBeforeShadow = () => {
      this.patches.casting.geometry.instanceCount = this.patches.casting.count;
    };
    this.casting.onBeforeRender = () => {
      this.patches.casting.geometry.instanceCount = 0;
    };
    for (const mesh of [this.drawn, this.casting]) {
      mesh.frustumCulled = false;
      mesh.matrixAutoUpdate = false;
      this.group.add(mesh);
    }
    this.group.add(this.tufts.mesh, this.stakes.mesh);
    this.group.visible = false;
    this.setDetail(this.detailLevel);
  }

  /** Textures of bare soil and of grass, which other materials share. */
  get soilDetail(): Texture {
    return this.detail.soil;
  }

  get grassDetail(): Texture {
    return this.detail.grass;
  }

  get coloring(): string {
    return this.coloringId;
  }

  set coloring(id: string) {
    this.coloringId = id;
    const range = scaleRange(id, this.heights);
    const hasDesign = this.textures?.design ? 1 : 0;
    this.uniforms.coloring.value.set(coloringIndex(id), range.low, range.high, hasDesign);
    this.showTufts();
    this.uniforms.contourStep.value = id === "height" ? CONTOUR_STEP : 0;
  }

  legend(): Legend | null {
    return legendOf(this.coloringId, scaleRange(this.coloringId, this.heights), this.site);
  }

  setDetail(level: TerrainDetail): void {
    this.detailLevel = level;
    setPlain(this.drawn.material, level.isPlain);
    this.showTufts();
    this.configurePatches();
  }

  /** Show another site, or none. */
  setSite(site: SiteMessage | null, terrain: TerrainState | null): void {
    this.textures?.dispose();
    this.maps?.dispose();
    this.textures = this.maps = null;
    this.site = site;
    this.group.visible = site !== null && terrain !== null;
    if (!site || !terrain) return;
    const textures = new HeightTextures(terrain);
    this.textures = textures;
    const { heightMap, grid, halfSize } = this.heightUniforms;
    heightMap.value = textures.height;
    grid.value.set(terrain.rows, terrain.cols, terrain.cell, borderMean(terrain));
    halfSize.value.set(0.5 * (terrain.rows - 1) * terrain.cell, 0.5 * (terrain.cols - 1) * terrain.cell);
    this.maps = new SurfaceMaps(textures, this.heightUniforms, site.soils);
    const [low, high] = textures.referenceRange;
    this.heights = { low: low - 1.5, high: high + 1.5 };
    this.setUniforms(textures, this.maps);
    this.stakes.place(terrain.rows * terrain.cell, terrain.cols * terrain.cell);
    this.configurePatches();
    this.coloring = this.coloringId;
  }

  /** Tufts would hide the colours that mean something. */
  private showTufts(): void {
    this.tufts.setReach(this.coloringId === "natural" ? this.detailLevel.tuftReach : 0);
  }

  private setUniforms(textures: HeightTextures, maps: SurfaceMaps): void {
    const { uniforms } = this;
    uniforms["shapeMap"]!.value = maps.shape;
    uniforms["surfaceMap"]!.value = maps.surface;
    uniforms["stateMap"]!.value = maps.state;
    uniforms["cellMap"]!.value = textures.cells;
    uniforms["designMap"]!.value = textures.design ?? textures.reference;
    uniforms.soilColors.value = maps.soilColors;
  }

  private configurePatches(): void {
    const { rows, cols, cell } = this.textures?.terrain ?? { rows: 1, cols: 1, cell: 0.2 };
    // Vertices lie on the cell centres, and evenly between them.
    const step = cell / Math.max(Math.min(this.detailLevel.subdivision, Math.floor(cell / 0.09)), 1);
    const origin = { x: rows % 2 ? 0 : cell / 2, y: cols % 2 ? 0 : cell / 2 };
    const bounds = { low: this.heights.low - 4, high: this.heights.high + 4 };
    this.patches.configure({ step, range: this.detailLevel.range, origin, bounds });
  }

  /** Bring what has changed onto the GPU. */
  upload(renderer: WebGLRenderer): void {
    if (!this.hasDetail) {
      this.detail.generate(renderer);
      this.hasDetail = true;
    }
    const changed = this.textures?.upload(renderer);
    if (!changed || !this.textures) return;
    this.maps?.update(renderer, changed);
    const { terrain } = this.textures;
    if (terrain.tilesReceived !== this.seenTiles) {
      this.seenTiles = terrain.tilesReceived;
      this.uniforms.commonSoil.value = commonSoil(terrain.cells);
    }
  }

  /** Make everything on the GPU again, after the loss of the context. */
  restore(terrain: TerrainState | null): void {
    this.hasDetail = false;
    this.textures = this.maps = null; // what they held is gone
    this.setSite(this.site, terrain);
  }

  /** Select the level of detail for a view; see `Patches.select`. */
  update(camera: Camera, eye: Vector3, focus: Vector3, focusRadius: number): void {
    this.patches.select(camera, eye, focus, focusRadius);
    this.uniforms.lodEye.value.set(eye.x, eye.y, eye.z, this.patches.finestRange);
    this.uniforms.lodGround.value = focus.z;
    this.tufts.update(eye, focus);
  }

  /** Shade the ground under a body. */
  setContact(index: number, x: number, y: number, yaw: number, halfLength: number, halfWidth: number): void {
    if (index >= MAX_CONTACTS) return;
    this.uniforms.contacts.value[index]!.set(x, y, halfLength, halfWidth);
    this.uniforms.contactAxes.value[index]!.set(Math.cos(yaw), Math.sin(yaw));
  }

  setContactCount(count: number): void {
    this.uniforms.contactCount.value = Math.min(count, MAX_CONTACTS);
  }

  /** Return the heights in the texture of a rectangle of cells [m], row by row. */
  readHeights(renderer: WebGLRenderer, row0: number, col0: number, rows: number, cols: number): number[] {
    return this.textures ? readHeights(renderer, this.textures, row0, col0, rows, cols) : [];
  }
}

function borderMean(terrain: TerrainState): number {
  const { rows, cols, reference } = terrain;
  let sum = 0;
  for (let row = 0; row < rows; row++) sum += reference[row * cols]! + reference[row * cols + cols - 1]!;
  for (let col = 0; col < cols; col++) sum += reference[col]! + reference[(rows - 1) * cols + col]!;
  return sum / (2 * (rows + cols));
}

/** Return the id of the most frequent soil. */
function commonSoil(cells: Uint8Array): number {
  const counts = new Uint32Array(256);
  for (let i = 0; i < cells.length; i += 4) counts[cells[i]!]!++;
  let most = 0;
  for (let id = 1; id < MAX_SOILS; id++) if (counts[id]! > counts[most]!) most = id;
  return most;
}
