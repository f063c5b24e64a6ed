// Shapes of geoms, where MuJoCo has them: its primitives, meshes and height fields.
import * as three from "three";
import type { MjModel } from "./engine";

export const [PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH] = [0, 1, 2, 3, 4, 5, 6, 7] as const;
const COARSEST = 200; // faces of meshes whose edges are drawn

/** The shape of a geom in its own frame; null where none is drawn. */
export function geometryOf(model: MjModel, geom: number): three.BufferGeometry | null {
  const [a, b, c] = model.geom_size.subarray(3 * geom, 3 * geom + 3) as unknown as [number, number, number];
  switch (model.geom_type[geom]) {
    case PLANE: {
      const [width, depth] = planeSize(model, geom);
      return new three.PlaneGeometry(2 * width, 2 * depth);
    }
    case SPHERE:
      return new three.SphereGeometry(a, 32, 16).rotateX(Math.PI / 2);
    case ELLIPSOID:
      return new three.SphereGeometry(1, 32, 16).rotateX(Math.PI / 2).scale(a, b, c);
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

/** Half the sides of a plane; of one without end, so much of it as the model needs. */
export function planeSize(model: MjModel, geom: number): [number, number] {
  const size = model.geom_size.subarray(3 * geom) as Float64Array;
  const reach = 20 * model.stat.extent;
  return [size[0] || reach, size[1] || reach];
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
