// The 3D view: geoms of a model where the simulation has them, a ghost, contacts as arrows.
import * as three from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { MjData, MjModel } from "./engine";
import type { Contact } from "./simulation";

const [PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH] = [0, 1, 2, 3, 4, 5, 6, 7];
const GROUPS = 3; // those that MuJoCo shows unasked
const ARROWS = 64;
const COARSEST = 200; // faces of meshes whose edges are drawn
const SLOW = 28; // ms of a frame above which it is drawn more coarsely
const COARSE = 0.5;
const FORCE = 0xd9480f;
const DEEPEST = 0xe03131;
const GHOST = 0x3b5bdb;

export class View {
  private readonly renderer: three.WebGLRenderer;
  private readonly scene = new three.Scene();
  private readonly camera = new three.PerspectiveCamera(40, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly arrows: three.Group[] = [];
  private readonly mark: three.Mesh;
  private bodies = new Map<number, three.Object3D>();
  private ghosts = new Map<number, three.Object3D>();
  private ghostModel: MjModel | null = null;
  private drawn = 0;
  private late = 0; // ms between frames, of late
  private extent = 1;
  private weight = 1;

  /** Draw into an element; throws where there is no WebGL. */
  constructor(private readonly element: HTMLElement) {
    this.renderer = new three.WebGLRenderer({ antialias: !drawnByProcessor(), powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    element.replaceChildren(this.renderer.domElement);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    const sun = new three.DirectionalLight(0xffffff, 2.2);
    sun.position.set(-1, -2, 4);
    this.scene.add(new three.HemisphereLight(0xffffff, 0x667788, 1.6), sun);
    const material = new three.MeshBasicMaterial({ color: DEEPEST, depthTest: false, transparent: true, opacity: 0.9 });
    this.mark = new three.Mesh(new three.SphereGeometry(1, 16, 8), material);
    this.mark.renderOrder = 2;
    this.scene.add(this.mark);
    for (let count = 0; count < ARROWS; count++) this.arrows.push(this.arrow());
    new ResizeObserver(() => this.fit()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    this.paint();
    this.fit();
  }

  private paint(): void {
    this.scene.background = new three.Color(getComputedStyle(document.body).getPropertyValue("--panel").trim() || "#eee");
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.element;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / Math.max(1, height);
    this.camera.updateProjectionMatrix();
  }

  private arrow(): three.Group {
    const material = new three.MeshBasicMaterial({ color: FORCE });
    const shaft = new three.Mesh(SHAFT, material);
    const head = new three.Mesh(HEAD, material);
    const arrow = new three.Group();
    arrow.add(shaft, head);
    arrow.visible = false;
    this.scene.add(arrow);
    return arrow;
  }

  /** Show a model, as it is in a state, from where all of it is seen. */
  show(model: MjModel, data: MjData): void {
    this.bodies = this.replace(this.bodies, model, false);
    this.place(data);
    // What moves; where nothing does, what has an end.
    const moving = [...this.bodies].filter(([geom]) => model.body_weldid[model.geom_bodyid[geom]!] !== 0);
    const ended = [...this.bodies].filter(([geom]) => model.geom_type[geom] !== PLANE && model.geom_type[geom] !== HFIELD);
    const box = new three.Box3();
    for (const [, object] of moving.length ? moving : ended) box.expandByObject(object);
    if (box.isEmpty()) box.set(new three.Vector3(-1, -1, -1), new three.Vector3(1, 1, 1));
    const sphere = box.getBoundingSphere(new three.Sphere());
    this.extent = Math.max(sphere.radius, 1e-3);
    const masses = model.body_mass as Float64Array;
    this.weight = Math.max(9.81 * masses.reduce((sum, mass) => sum + mass, 0), 1e-9);
    const away = new three.Vector3(1.1, -2.2, 0.9).normalize().multiplyScalar(3.4 * this.extent);
    this.controls.target.copy(sphere.center);
    this.camera.position.copy(sphere.center).add(away);
    this.camera.near = this.extent / 100;
    this.camera.far = this.extent * 200;
    this.camera.updateProjectionMatrix();
    this.controls.update();
  }

  /** Show a model as a ghost, or none. */
  showGhost(model: MjModel | null): void {
    if (model === this.ghostModel) return;
    this.ghostModel = model;
    this.ghosts = this.replace(this.ghosts, model, true);
  }

  private replace(old: Map<number, three.Object3D>, model: MjModel | null, ghost: boolean): Map<number, three.Object3D> {
    for (const object of old.values()) {
      this.scene.remove(object);
      object.traverse((part) => {
        if (part instanceof three.Mesh) part.geometry.dispose();
      });
    }
    const made = new Map<number, three.Object3D>();
    for (let geom = 0; model && geom < model.ngeom; geom++) {
      const still = model.body_weldid[model.geom_bodyid[geom]!] === 0;
      if (model.geom_group[geom]! >= GROUPS || (ghost && still)) continue;
      const object = drawn(model, geom, ghost);
      if (!object) continue;
      object.matrixAutoUpdate = false;
      this.scene.add(object);
      made.set(geom, object);
    }
    return made;
  }

  place(data: MjData): void {
    put(this.bodies, data);
  }

  placeGhost(data: MjData): void {
    put(this.ghosts, data);
  }

  /** Draw forces, so long that the weight of everything is half the extent, and the deepest contact. */
  showContacts(contacts: readonly Contact[], deepest: Contact | undefined): void {
    const strongest = [...contacts].sort((one, other) => other.normal - one.normal).slice(0, ARROWS);
    this.arrows.forEach((arrow, place) => {
      const contact = strongest[place];
      arrow.visible = contact !== undefined && contact.normal > 1e-9;
      if (!contact || !arrow.visible) return;
      const length = this.extent * Math.min(1.5, Math.max(0.06, (0.5 * contact.normal) / this.weight));
      const thick = 0.015 * this.extent;
      const head = Math.min(0.4 * length, 6 * thick);
      arrow.position.set(...contact.at);
      arrow.quaternion.setFromUnitVectors(UP, new three.Vector3(...contact.force).normalize());
      arrow.children[0]!.scale.set(thick, length - head, thick);
      arrow.children[1]!.scale.set(3 * thick, head, 3 * thick);
      arrow.children[1]!.position.y = length - head;
    });
    this.mark.visible = deepest !== undefined && deepest.depth > 0;
    if (deepest) this.mark.position.set(...deepest.at);
    this.mark.scale.setScalar(0.025 * this.extent);
  }

  /** Draw; while something moves as finely as keeps up, and else as finely as the screen is. */
  draw(moving: boolean): void {
    const now = performance.now();
    const passed = now - this.drawn;
    this.drawn = now;
    if (moving && passed < 500) this.late = 0.9 * this.late + 0.1 * passed;
    const ratio = moving && this.late > SLOW ? COARSE : Math.min(devicePixelRatio, 2);
    if (ratio !== this.renderer.getPixelRatio()) this.renderer.setPixelRatio(ratio);
    this.renderer.render(this.scene, this.camera);
  }

  /** Call back when the reader turns the view. */
  onTurn(redraw: () => void): void {
    this.controls.addEventListener("change", redraw);
  }
}

/** Whether the processor draws, whose time smooth edges take the most of. */
function drawnByProcessor(): boolean {
  const probe = document.createElement("canvas").getContext("webgl2");
  const facts = probe?.getExtension("WEBGL_debug_renderer_info");
  const name = facts ? String(probe!.getParameter(facts.UNMASKED_RENDERER_WEBGL)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software/i.test(name);
}

const UP = new three.Vector3(0, 1, 0);
const SHAFT = new three.CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0);
const HEAD = new three.ConeGeometry(1, 1, 14).translate(0, 0.5, 0);

function put(objects: Map<number, three.Object3D>, data: MjData): void {
  const [at, turned] = [data.geom_xpos as Float64Array, data.geom_xmat as Float64Array];
  for (const [geom, object] of objects) {
    const [p, r] = [3 * geom, 9 * geom];
    object.matrix.set(
      turned[r]!, turned[r + 1]!, turned[r + 2]!, at[p]!,
      turned[r + 3]!, turned[r + 4]!, turned[r + 5]!, at[p + 1]!,
      turned[r + 6]!, turned[r + 7]!, turned[r + 8]!, at[p + 2]!,
      0, 0, 0, 1,
    );
    object.matrixWorldNeedsUpdate = true;
  }
}

function drawn(model: MjModel, geom: number, ghost: boolean): three.Object3D | null {
  const geometry = geometryOf(model, geom);
  if (!geometry) return null;
  const material = model.geom_matid[geom]! >= 0 ? model.mat_rgba.subarray(4 * model.geom_matid[geom]!) : model.geom_rgba.subarray(4 * geom);
  const [red, green, blue, alpha] = material as Float32Array as unknown as [number, number, number, number];
  if (!alpha) return null;
  const colour = ghost ? new three.Color(GHOST) : new three.Color().setRGB(red, green, blue, three.SRGBColorSpace);
  const opacity = ghost ? 0.25 : alpha;
  const look = new three.MeshLambertMaterial({
    color: colour,
    opacity,
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
    side: model.geom_type[geom] === PLANE ? three.DoubleSide : three.FrontSide,
    // Lines on a plane, and what a ghost is over, are seen.
    polygonOffset: ghost || model.geom_type[geom] === PLANE,
    polygonOffsetFactor: 1,
    polygonOffsetUnits: 1,
  });
  const mesh = new three.Mesh(geometry, look);
  if (model.geom_type[geom] !== PLANE) return mesh;
  const parent = new three.Group();
  const lines = new three.GridHelper(2, 40, 0x808890, 0x808890).rotateX(Math.PI / 2);
  const size = planeSize(model, geom);
  lines.scale.set(size[0], 1, size[1]);
  Object.assign(lines.material as three.Material, { transparent: true, opacity: 0.35 });
  parent.add(mesh, lines);
  return parent;
}

/** Half the sides of a plane; of one without end, so much of it as the model needs. */
function planeSize(model: MjModel, geom: number): [number, number] {
  const size = model.geom_size.subarray(3 * geom) as Float64Array;
  const reach = 20 * model.stat.extent;
  return [size[0] || reach, size[1] || reach];
}

function geometryOf(model: MjModel, geom: number): three.BufferGeometry | null {
  const [a, b, c] = model.geom_size.subarray(3 * geom, 3 * geom + 3) as unknown as [number, number, number];
  switch (model.geom_type[geom]) {
    case PLANE: {
      const [width, depth] = planeSize(model, geom);
      return new three.PlaneGeometry(2 * width, 2 * depth);
    }
    case SPHERE:
      return new three.SphereGeometry(a, 32, 16);
    case ELLIPSOID:
      return new three.SphereGeometry(1, 32, 16).scale(a, b, c);
    case CAPSULE:
      return new three.CapsuleGeometry(a, 2 * b, 8, 20).rotateX(Math.PI / 2);
    case CYLINDER:
      return new three.CylinderGeometry(a, a, 2 * b, 32).rotateX(Math.PI / 2);
    case BOX:
      return new three.BoxGeometry(2 * a, 2 * b, 2 * c);
    case MESH:
      return meshGeometry(model, model.geom_dataid[geom]!);
    case HFIELD:
      return fieldGeometry(model, model.geom_dataid[geom]!);
    default:
      return null;
  }
}

function meshGeometry(model: MjModel, mesh: number): three.BufferGeometry {
  const [vertex, count] = [model.mesh_vertadr[mesh]!, model.mesh_vertnum[mesh]!];
  const [face, faces] = [model.mesh_faceadr[mesh]!, model.mesh_facenum[mesh]!];
  const points = new Float32Array(model.mesh_vert.subarray(3 * vertex, 3 * (vertex + count)));
  const corners = new Uint32Array(model.mesh_face.subarray(3 * face, 3 * (face + faces)));
  const geometry = new three.BufferGeometry();
  // Coarse meshes have edges; the points of fine ones, often one for each corner, are few once equal ones are one.
  const smooth = faces > COARSEST ? welded(points, corners) : { points, corners };
  geometry.setAttribute("position", new three.BufferAttribute(smooth.points, 3));
  geometry.setIndex(new three.BufferAttribute(smooth.corners, 1));
  const made = faces > COARSEST ? geometry : geometry.toNonIndexed();
  made.computeVertexNormals();
  return made;
}

/** Make one of points that are equal bit for bit, by a table with open addresses. */
function welded(points: Float32Array, corners: Uint32Array): { points: Float32Array; corners: Uint32Array } {
  const bits = new Int32Array(points.buffer);
  const count = points.length / 3;
  let size = 1;
  while (size < 2 * count) size *= 2;
  const table = new Int32Array(size).fill(-1);
  const places = new Uint32Array(count);
  const kept = new Float32Array(points.length);
  const keptBits = new Int32Array(kept.buffer);
  let next = 0;
  for (let point = 0; point < count; point++) {
    const [x, y, z] = [bits[3 * point]!, bits[3 * point + 1]!, bits[3 * point + 2]!];
    let slot = (Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791)) & (size - 1);
    for (; ; slot = (slot + 1) & (size - 1)) {
      const found = table[slot]!;
      if (found < 0) {
        table[slot] = next;
        keptBits.set([x, y, z], 3 * next);
        places[point] = next++;
        break;
      }
      if (keptBits[3 * found] === x && keptBits[3 * found + 1] === y && keptBits[3 * found + 2] === z) {
        places[point] = found;
        break;
      }
    }
  }
  return { points: kept.slice(0, 3 * next), corners: corners.map((corner) => places[corner]!) };
}

function fieldGeometry(model: MjModel, field: number): three.BufferGeometry {
  const [rows, columns] = [model.hfield_nrow[field]!, model.hfield_ncol[field]!];
  const [width, depth, height] = model.hfield_size.subarray(4 * field, 4 * field + 3) as unknown as [number, number, number];
  const geometry = new three.PlaneGeometry(2 * width, 2 * depth, columns - 1, rows - 1);
  const points = geometry.getAttribute("position");
  const from = model.hfield_adr[field]!;
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) {
      // The plane's first row is at its far side.
      points.setZ((rows - 1 - row) * columns + column, height * model.hfield_data[from + row * columns + column]!);
    }
  }
  geometry.computeVertexNormals();
  return geometry;
}
