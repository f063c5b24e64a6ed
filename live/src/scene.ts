// The 3D view: geoms of a model where the simulation has them, a ghost, contacts as arrows.
import * as three from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { Arrows } from "./arrows";
import type { MjData, MjModel } from "./engine";
import { HFIELD, PLANE, geometryOf, planeSize } from "./geometry";
import type { Contact } from "./simulation";
import { NO_SURFACES, type Surfaces } from "./surface";

const GROUPS = 3; // those that MuJoCo shows unasked
const SLOW = 28; // ms of a frame above which it is drawn more coarsely
const COARSE = 0.5;
const LINES = 0x30363d;

export class View {
  private readonly renderer: three.WebGLRenderer;
  private readonly scene = new three.Scene();
  private readonly camera = new three.PerspectiveCamera(40, 1, 0.01, 1000);
  private readonly controls: OrbitControls;
  private readonly arrows = new Arrows();
  private bodies = new Map<number, three.Object3D>();
  private ghosts = new Map<number, three.Object3D>();
  private ghostModel: MjModel | null = null;
  private framed = false;
  private drawn = 0;
  private late = 0; // ms between frames, of late
  private extent = 1;
  private weight = 1;

  /** Whether a graphics card draws, not the processor. */
  readonly isFast = !drawnByProcessor();

  /** Draw into an element; throws where there is no WebGL. */
  constructor(private readonly element: HTMLElement) {
    this.renderer = new three.WebGLRenderer({ antialias: this.isFast, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.outputColorSpace = three.LinearSRGBColorSpace; // as colours are
    element.replaceChildren(this.renderer.domElement);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.scene.add(this.arrows.group);
    new ResizeObserver(() => this.fit()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    this.paint();
    this.fit();
  }

  private paint(): void {
    this.scene.background = new three.Color(getComputedStyle(document.body).getPropertyValue("--panel").trim() || "#eee");
    this.renderer.render(this.scene, this.camera);
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.element;
    this.renderer.setSize(width, height);
    this.camera.aspect = width / Math.max(1, height);
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
  }

  /** Show a model, as it is in a state; after another was left, from where all of it is seen. */
  show(model: MjModel, data: MjData, surfaces: Surfaces): void {
    this.bodies = this.replace(this.bodies, model, surfaces, false);
    this.place(data);
    const masses = model.body_mass as Float64Array;
    this.weight = Math.max(9.81 * masses.reduce((sum, mass) => sum + mass, 0), 1e-9);
    if (!this.framed) this.frame(model);
  }

  /** Show nothing of this model any more. */
  leave(): void {
    this.framed = false;
    this.ghostModel = null;
    this.ghosts = this.replace(this.ghosts, null, NO_SURFACES, true);
  }

  private frame(model: MjModel): void {
    this.framed = true;
    // What moves; where nothing does, what has an end.
    const moving = [...this.bodies].filter(([geom]) => model.body_weldid[model.geom_bodyid[geom]!] !== 0);
    const ended = [...this.bodies].filter(([geom]) => model.geom_type[geom] !== PLANE && model.geom_type[geom] !== HFIELD);
    const box = new three.Box3();
    for (const [, object] of moving.length ? moving : ended) box.expandByObject(object);
    if (box.isEmpty()) box.set(new three.Vector3(-1, -1, -1), new three.Vector3(1, 1, 1));
    const sphere = box.getBoundingSphere(new three.Sphere());
    this.extent = Math.max(sphere.radius, 1e-3);
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
    this.ghosts = this.replace(this.ghosts, model, NO_SURFACES, true);
  }

  private replace(old: Map<number, three.Object3D>, model: MjModel | null, surfaces: Surfaces, ghost: boolean): Map<number, three.Object3D> {
    for (const object of old.values()) {
      this.scene.remove(object);
      object.traverse((part) => {
        if (part instanceof three.Mesh) {
          part.geometry.dispose();
          (part.material as three.Material).dispose();
        }
      });
    }
    const made = new Map<number, three.Object3D>();
    for (let geom = 0; model && geom < model.ngeom; geom++) {
      const still = model.body_weldid[model.geom_bodyid[geom]!] === 0;
      if (model.geom_group[geom]! >= GROUPS || (ghost && still)) continue;
      const object = drawn(model, geom, surfaces, ghost);
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

  /** Draw forces of contacts, and the deepest one. */
  showContacts(contacts: readonly Contact[], deepest: Contact | undefined): void {
    this.arrows.show(contacts, deepest, this.extent, this.weight);
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

function drawn(model: MjModel, geom: number, surfaces: Surfaces, ghost: boolean): three.Object3D | null {
  const geometry = geometryOf(model, geom);
  const look = geometry && surfaces.of(model, geom, ghost);
  if (!look) return null;
  const mesh = new three.Mesh(geometry, look);
  const isPlane = model.geom_type[geom] === PLANE;
  // Lines on a plane, and what a ghost is over, are seen.
  if (ghost || isPlane) Object.assign(look, { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1 });
  if (isPlane) look.side = three.DoubleSide;
  if (!isPlane || look.defines.PICTURE) return mesh;
  const lines = new three.GridHelper(2, 40, LINES, LINES).rotateX(Math.PI / 2);
  const size = planeSize(model, geom);
  lines.scale.set(size[0], 1, size[1]);
  Object.assign(lines.material as three.Material, { transparent: true, opacity: 0.35 });
  return new three.Group().add(mesh, lines);
}
