// Colours, light and textures of surfaces. As in MuJoCo's own renderer light is of corners, and in
// the colours of the screen: a processor that draws has a third of the work of light for each pixel.
import * as three from "three";
import type { MjModel } from "./engine";
import { MESH } from "./geometry";
import { type Model, type Texture, blob } from "./page_data";

three.ColorManagement.enabled = false;

const UNSAID: Colour = [0.5, 0.5, 0.5, 1]; // MuJoCo's grey, of what has no colour: beside a floor of the same it is hardly seen
const MOVING: Colour = [0.45, 0.56, 0.7, 1];
const GHOST: Colour = [0.23, 0.36, 0.86, 0.25];

type Colour = readonly [number, number, number, number];

// Sky, ground and a sun; what is drawn in three dimensions has the frame of the world.
const CORNERS = `
varying vec3 lit;
varying vec2 place;
uniform vec3 base;
uniform vec4 spread;
void main() {
  vec3 normal = normalize(mat3(modelMatrix) * normal);
  float sun = max(dot(normal, vec3(-.218, -.436, .873)), 0.);
  float sky = .5 + .5 * normal.z;
  lit = min(base * (.42 + .22 * sky + .46 * sun), 1.);
  place = spread.xy * position.xy + spread.zw;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.);
}`;
const PIXELS = `
varying vec3 lit;
varying vec2 place;
uniform float opacity;
#ifdef PICTURE
uniform sampler2D picture;
#endif
void main() {
  gl_FragColor = vec4(lit, opacity);
#ifdef PICTURE
  gl_FragColor.rgb *= texture2D(picture, place).rgb;
#endif
}`;

/** Textures of a model by material: pictures, or one colour of those that are put around a body. */
export class Surfaces {
  private constructor(
    private readonly textures: ReadonlyMap<number, Texture>,
    private readonly pictures: ReadonlyMap<number, three.Texture>,
  ) {}

  static plain(): Surfaces {
    return new Surfaces(new Map(), new Map());
  }

  static async of(textures: readonly Texture[], smooth: boolean): Promise<Surfaces> {
    const pictures = new Map<number, three.Texture>();
    for (const texture of textures) {
      if (texture.blob === undefined) continue;
      const made = new three.DataTexture(await blob(texture.blob), texture.width, texture.height);
      made.wrapS = made.wrapT = three.RepeatWrapping;
      made.magFilter = smooth ? three.LinearFilter : three.NearestFilter;
      made.minFilter = smooth ? three.LinearMipmapLinearFilter : three.NearestMipmapNearestFilter;
      made.generateMipmaps = true;
      made.flipY = true;
      made.needsUpdate = true;
      pictures.set(texture.material, made);
    }
    return new Surfaces(new Map(textures.map((texture) => [texture.material, texture])), pictures);
  }

  /** The surface of a geom; null where it is not seen. */
  of(model: MjModel, geom: number, ghost: boolean): three.ShaderMaterial | null {
    const material = model.geom_matid[geom]!;
    const rgba = material >= 0 ? model.mat_rgba.subarray(4 * material) : model.geom_rgba.subarray(4 * geom);
    const isUnsaid = material < 0 && UNSAID.every((part, place) => rgba[place] === part);
    const moves = model.body_weldid[model.geom_bodyid[geom]!] !== 0;
    const [red, green, blue, alpha] = isUnsaid && moves ? MOVING : (rgba as Float32Array as unknown as Colour);
    if (!alpha) return null;
    if (ghost) return surface(GHOST);
    const texture = this.textures.get(material);
    // Where a picture lies on a mesh, only its file says: its mean colour is seen there.
    const picture = model.geom_type[geom] === MESH ? undefined : this.pictures.get(material);
    const mean = texture && !picture ? texture.mean : [1, 1, 1];
    const made = surface([red * mean[0]!, green * mean[1]!, blue * mean[2]!, alpha]);
    if (picture && texture) {
      // Repeated over the whole geom, or over each metre, as of a plane without end.
      const [width, depth] = model.geom_size.subarray(3 * geom) as Float64Array as unknown as [number, number];
      const over = (half: number): number => (texture.uniform || half <= 0 ? 1 : 2 * half);
      const [across, along] = texture.repeat;
      Object.assign(made.defines, { PICTURE: 1 });
      made.uniforms.picture = { value: picture };
      made.uniforms.spread = { value: new three.Vector4(across / over(width), along / over(depth), 0.5, 0.5) };
    }
    return made;
  }
}

/** Those of what has one colour, as ghosts have. */
export const NO_SURFACES = Surfaces.plain();

/** The surfaces of the models of a page, each made once. */
export class Looks {
  private readonly made = new Map<number, Promise<Surfaces>>();

  /** Pictures are smooth where a graphics card draws them. */
  constructor(
    private readonly models: readonly Model[],
    private readonly smooth: boolean,
  ) {}

  of(place: number): Promise<Surfaces> {
    if (!this.made.has(place)) this.made.set(place, Surfaces.of(this.models[place]!.textures, this.smooth));
    return this.made.get(place)!;
  }
}

function surface([red, green, blue, opacity]: Colour): three.ShaderMaterial {
  return new three.ShaderMaterial({
    vertexShader: CORNERS,
    fragmentShader: PIXELS,
    defines: {},
    uniforms: {
      base: { value: new three.Vector3(red, green, blue) },
      opacity: { value: opacity },
      spread: { value: new three.Vector4() },
    },
    transparent: opacity < 1,
    depthWrite: opacity >= 1,
  });
}
