// Forces of contacts as arrows, each part of all of them one call to draw, and the deepest contact.
import * as three from "three";
import type { Contact } from "./simulation";

const MOST = 64;
const FORCE = 0xd9480f;
const DEEPEST = 0xe03131;
const UP = new three.Vector3(0, 1, 0);

export class Arrows {
  readonly group = new three.Group();
  private readonly shafts: three.InstancedMesh;
  private readonly heads: three.InstancedMesh;
  private readonly mark: three.Mesh;
  private readonly pose = new three.Matrix4();
  private readonly at = new three.Vector3();
  private readonly along = new three.Vector3();
  private readonly scale = new three.Vector3();
  private readonly turn = new three.Quaternion();

  constructor() {
    const colour = new three.MeshBasicMaterial({ color: FORCE });
    this.shafts = new three.InstancedMesh(new three.CylinderGeometry(1, 1, 1, 10).translate(0, 0.5, 0), colour, MOST);
    this.heads = new three.InstancedMesh(new three.ConeGeometry(1, 1, 14).translate(0, 0.5, 0), colour, MOST);
    const marked = new three.MeshBasicMaterial({ color: DEEPEST, depthTest: false, transparent: true, opacity: 0.9 });
    this.mark = new three.Mesh(new three.SphereGeometry(1, 16, 8), marked);
    this.mark.renderOrder = 2;
    for (const each of [this.shafts, this.heads]) each.frustumCulled = false;
    this.group.add(this.shafts, this.heads, this.mark);
    this.show([], undefined, 1, 1);
  }

  /** Draw forces, so long that the weight of everything is half the extent, and the deepest contact. */
  show(contacts: readonly Contact[], deepest: Contact | undefined, extent: number, weight: number): void {
    const strongest = contacts.filter((each) => each.normal > 1e-9).sort((one, other) => other.normal - one.normal).slice(0, MOST);
    const thick = 0.015 * extent;
    strongest.forEach((contact, place) => {
      const length = extent * Math.min(1.5, Math.max(0.06, (0.5 * contact.normal) / weight));
      const head = Math.min(0.4 * length, 6 * thick);
      this.along.set(...contact.force).normalize();
      this.turn.setFromUnitVectors(UP, this.along);
      this.at.set(...contact.at);
      this.shafts.setMatrixAt(place, this.pose.compose(this.at, this.turn, this.scale.set(thick, length - head, thick)));
      this.at.addScaledVector(this.along, length - head);
      this.heads.setMatrixAt(place, this.pose.compose(this.at, this.turn, this.scale.set(3 * thick, head, 3 * thick)));
    });
    for (const each of [this.shafts, this.heads]) {
      each.count = strongest.length;
      each.visible = strongest.length > 0;
      each.instanceMatrix.needsUpdate = true;
    }
    this.mark.visible = deepest !== undefined && deepest.depth > 0;
    if (deepest) this.mark.position.set(...deepest.at);
    this.mark.scale.setScalar(0.025 * extent);
  }
}
