// Made by npm/generate.mjs.
/** A path, a file: URL, or the bytes of a file. */
export type Input = string | URL | ArrayBufferView | ArrayBuffer;

export interface Progress {
  /** Finished fraction in [0, 1]. */
  fraction: number;
  seconds: number;
  /** Mean paths per pixel so far. */
  spp: number;
  /** Estimated relative error; null before it is known. */
  noise: number | null;
}

export interface Abort {
  /** Ends the call: it rejects with the signal's reason. */
  signal?: AbortSignal | undefined;
}

export interface Result {
  /** What `bismar render --stats` writes. */
  stats: Record<string, any>;
  warnings: string[];
}

/** Flags of `bismar render`, which the texts speak of. */
export interface RenderFlags {
  /** The file's scene, by name or index [default: the file's default scene] */
  scene?: string | number | readonly (string | number)[] | undefined;
  /** Material variant (KHR_materials_variants), by name or index [default: the default materials] */
  variant?: string | number | readonly (string | number)[] | undefined;
  /** Time of the animations, in seconds [default: the rest pose, without animations] */
  pose?: number | string | undefined;
  /** Time of the animations, in frames of --fps from 0 */
  frame?: number | string | undefined;
  /** Frames per second, for --frame, --frames and --shutter */
  fps?: number | string | undefined;
  /** Animation to play, by name or index, or all: every animation at once [default: all] */
  animation?: string | number | readonly (string | number)[] | undefined;
  /** Motion blur: shutter opening and closing time in frames of --fps, relative to the time shown, as in -0.25,0.25 [default: no motion blur] */
  shutter?: string | number | readonly (string | number)[] | undefined;
  /** Number of linear motion segments while the shutter is open, 1 to 128 [default: chosen by the motion's curvature] */
  motion_steps?: number | string | undefined;
  /** Camera by name or by index from 0; framed: a view that fits the whole scene; or panorama: all directions from the first camera, or from the scene's centre, as an equirectangular picture in the orientation of --env [default: the first camera, or framed if the scene has none] */
  camera?: string | number | readonly (string | number)[] | undefined;
  /** View from a point around the scene, in degrees: azimuth 0 sees it from +z (the front of a glTF asset), 90 from +x; elevation is -90 to 90. The distance to the centre of what the scene shows is a multiple of that at which the sphere around it just fits [default: 1] */
  orbit?: string | number | readonly (string | number)[] | undefined;
  /** Other defaults of some flags, for an occasion; flags that are given win */
  preset?: "thumbnail" | "product" | "final" | undefined;
  /** Resolution in pixels [default: 960 wide, with the height from the camera's aspect ratio] */
  size?: string | number | readonly (string | number)[] | undefined;
  /** Crop window in pixels from the top left; x1 and y1 are exclusive. Its pixels are bit-identical to those of the full render */
  crop?: string | number | readonly (string | number)[] | undefined;
  /** Thin-lens aperture: an f-stop such as f/2.8 (for a sensor 24 mm high) or a radius in metres. glTF cameras have no aperture [default: pinhole] */
  aperture?: string | number | readonly (string | number)[] | undefined;
  /** Focus distance in metres along the camera's axis, or auto: the distance of what the centre of the picture shows */
  focus?: string | number | readonly (string | number)[] | undefined;
  /** Number of aperture blades, 3 to 32, or 0 for a circular aperture */
  lens_blades?: number | string | undefined;
  /** Back faces of single-sided materials: cull lets rays from the camera and their mirror images pass them, as glTF asks; show draws them, for closed rooms seen from outside */
  back_faces?: "cull" | "show" | undefined;
  /** Ignore the camera's clipping planes, znear and zfar. Without this the camera sees only what lies between them; shadows and mirrors see all */
  no_clip?: boolean | undefined;
  /** What lies below the scene: none; or shadow, a plane at its lowest point that shows only what the scene takes from its light, as black with alpha, seen from above. The environment is hidden, as by --transparent. Light that the scene adds to the ground, and what the ground would reflect, is left out */
  ground?: "none" | "shadow" | undefined;
  /** Shadow rays at bodies of smooth glass (a bottle, a globe, a pane with thickness): off ends them there, straight lets them pass, dimmed by Fresnel and absorption. That is approximate: without refraction and caustics, with little noise. They always pass thin glass */
  glass_shadows?: "off" | "straight" | undefined;
  /** Environment map: an equirectangular .hdr or .exr */
  env?: string | undefined;
  /** Rotation of the environment map about +y, in degrees */
  env_rotate?: number | string | undefined;
  /** Factor on the radiance of --env, --sky or --sunsky */
  env_strength?: number | string | undefined;
  /** Uniform white environment */
  sky?: boolean | undefined;
  /** A clear sky with its sun, by the sun's elevation and azimuth (0 in +z, 90 in +x) in degrees and the haze, from 1 to 10 [default: 3] (docs/lights.md) */
  sunsky?: string | number | readonly (string | number)[] | undefined;
  /** Unit of the file's point, spot and directional lights: lumen uses their intensities unchanged, watt divides them by 683 lm/W, the factor that Blender's exporter multiplies by */
  light_unit?: "lumen" | "watt" | undefined;
  /** Radius of all point and spot lights: spheres with the irradiance that the points have, soft shadows, and highlights. The camera does not see them. Without this, `radius` in the file's extras, or points */
  light_radius?: number | string | undefined;
  /** Angle that all directional lights subtend, at most 180; the sun has 0.53. Without this, `angle` (radians) in the file's extras, or sharp shadows */
  sun_angle?: number | string | undefined;
  /** Layers light_NAME in place of the kinds of --aov lights: at most 8 groups of lights by the names of lights, nodes, meshes and materials, with * and ?; env is the environment. `light_group` in the extras of a node, light or material goes before patterns. Other lights are in the layer light_rest; the sum is the beauty (docs/lights.md) */
  light_groups?: string | number | readonly (string | number)[] | undefined;
  /** Render without any environment light */
  no_env?: boolean | undefined;
  /** Compensate the energy that microfacet models with a single scattering lose on rough surfaces, up to 69 % for rough metals. Off: the letter of glTF 2.0, appendix B, as Mitsuba's principled BSDF */
  energy_compensation?: "on" | "off" | boolean | undefined;
  /** Light transport to simulate */
  integrator?: "path" | "direct" | undefined;
  /** Largest number of segments of a path: 1 is emission only, 2 adds direct light. Mirror-like bounces at smooth glass are not counted */
  max_depth?: number | string | undefined;
  /** Stop at this many paths per pixel */
  spp?: number | string | undefined;
  /** Stop after this wall time, loading included: in seconds, or with a unit as in 90s, 10m, 1.5h. A resumed render counts the time of all its sessions. The first passes are small, so that every pixel has paths early */
  time?: number | string | undefined;
  /** Stop sampling each tile of 16 x 16 pixels when its estimated relative error, sqrt(mean(variance / (mean^2 + 0.01))), is at most this */
  noise?: number | string | undefined;
  /** Paths per pixel before --noise may stop a tile [default: 32] */
  min_spp?: number | string | undefined;
  /** Compensated environment density: draw light samples of the environment by its radiance above the mean (docs/balance.md) [default: auto with --balance progressive, else off] */
  compensation?: "off" | "on" | "auto" | boolean | undefined;
  /** Learned light selection: choose among emissive triangles by what a pre-pass has learned (docs/balance.md) [default: auto with --balance progressive, else off] */
  learned_lights?: "off" | "on" | "auto" | boolean | undefined;
  /** Path guiding: sample directions from the light field that a pre-pass has learned (docs/guiding.md). It helps where light reaches the visible surfaces through few paths [default: auto with --balance progressive, else off] */
  guiding?: "off" | "on" | "auto" | boolean | undefined;
  /** Path re-use: pixels of a tile share what their paths find at second surfaces (docs/path-reuse.md). It helps where most light arrives by other surfaces; the errors of neighbouring pixels are then related. Before a denoiser it gains little, and is off unless it is given. N: groups of N paths; N:M: M of these go on from there, for all [default: auto with --balance progressive, else off] */
  path_reuse?: string | number | readonly (string | number)[] | undefined;
  /** Adaptive sampling: a pre-pass estimates the noise of each tile of 16 x 16 pixels, and noisy tiles get more paths; the number of paths is their mean (docs/adaptive.md). Without effect with a goal of noise [default: auto with --balance progressive, else off; --adaptive alone: on] */
  adaptive?: "off" | "on" | "auto" | boolean | undefined;
  /** Method that sets the share of light samples and BSDF samples in multiple importance sampling (docs/balance.md) */
  balance?: "progressive" | "second-order" | "kl" | "efficiency-aware" | "half" | "power" | "max" | undefined;
  /** For --balance second-order: the pilot's share of all paths, between 0 and 1 [default: 0.5] */
  pilot?: number | string | undefined;
  /** Memory limit of the guiding field, such as 256M or 1G [default: 256M] */
  guiding_memory?: number | string | undefined;
  /** Clamp direct light: largest radiance, in the brightest channel, of one contribution at the first surface. Removes fireflies, but the picture becomes darker than the truth [default: no limit] */
  clamp_direct?: number | string | undefined;
  /** Clamp indirect light: largest radiance, in the brightest channel, of one contribution found after the first surface [default: no limit] */
  clamp_indirect?: number | string | undefined;
  /** Pixel reconstruction filter, applied by importance sampling */
  filter?: "gaussian" | "box" | "blackman-harris" | undefined;
  /** Seed of the random number generator */
  seed?: number | string | undefined;
  /** Vary the seed with the frame number, so that the noise pattern changes from frame to frame [default: true with --frames, else false] */
  seed_per_frame?: "true" | "false" | boolean | undefined;
  /** Ray tracing library */
  rays?: "embree" | "obvhs" | undefined;
  /** Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores] */
  threads?: number | string | undefined;
  /** Memory limit, such as 900M or 6G: a render that needs more is refused [default: Slurm's limit, else the machine's memory] */
  memory_limit?: number | string | undefined;
  /** AOVs to write in addition to the beauty, separated by commas, or all, or none: albedo, normal, depth, direct, indirect, variance, samples, balance, object, material, position, uv, emission, guide-albedo and guide-normal (followed through mirrors, for denoisers), lights (the beauty by type of light source), velocity (pixels per frame), crypto-object, crypto-material */
  aovs?: string | number | readonly (string | number)[] | undefined;
  /** Write colours and normals as 16-bit floats, which halves the file size */
  half?: boolean | undefined;
  /** Primaries of the EXR's colours, which its attribute `chromaticities` says. The variance stays that of Rec. 709 */
  colorspace?: "rec709" | "acescg" | "rec2020" | undefined;
  /** Hide the environment from the camera and write alpha. The environment still lights the scene */
  transparent?: boolean | undefined;
  /** Add a denoised layer `denoised`, and show it in the PNG; layers of lights get a `denoised_NAME` each. The beauty stays unchanged */
  denoise?: "oidn" | boolean | undefined;
  /** View transform of the PNG: one of these, or a LUT (.cube) whose result is display-encoded */
  view?: "agx" | "neutral" | "aces" | "srgb" | (string & {}) | undefined;
  /** What the LUT takes: linear rec709, acescg or rec2020; acescct; or log2:MIN,MAX, in stops of linear Rec. 709 (also acescg-log2:MIN,MAX) [default: as its comment `# input space: SPACE` says, else rec709] */
  view_space?: string | number | readonly (string | number)[] | undefined;
  /** Exposure of the PNG in stops, or auto: the log-mean of all parts that are not dark becomes middle grey. The value is printed and stored in the EXR header (bismar.exposure), so that other pictures of a sequence can use it */
  exposure?: string | number | readonly (string | number)[] | undefined;
  /** Refuse a scene with features that can only be approximated or ignored */
  strict?: boolean | undefined;
}

/** Flags of `bismar inspect`, which the texts speak of. */
export interface InspectFlags {
  /** The file's scene, by name or index [default: the file's default scene] */
  scene?: string | number | readonly (string | number)[] | undefined;
  /** Material variant (KHR_materials_variants), by name or index [default: the default materials] */
  variant?: string | number | readonly (string | number)[] | undefined;
  /** Time of the animations, in seconds [default: the rest pose, without animations] */
  pose?: number | string | undefined;
  /** Time of the animations, in frames of --fps from 0 */
  frame?: number | string | undefined;
  /** Frames per second, for --frame, --frames and --shutter */
  fps?: number | string | undefined;
  /** Animation to play, by name or index, or all: every animation at once [default: all] */
  animation?: string | number | readonly (string | number)[] | undefined;
  /** Motion blur: shutter opening and closing time in frames of --fps, relative to the time shown, as in -0.25,0.25 [default: no motion blur] */
  shutter?: string | number | readonly (string | number)[] | undefined;
  /** Number of linear motion segments while the shutter is open, 1 to 128 [default: chosen by the motion's curvature] */
  motion_steps?: number | string | undefined;
  /** Environment map that the scene is to have, an equirectangular .hdr or .exr. No studio light is then added */
  env?: string | undefined;
}

/** Flags of `bismar compare`, which the texts speak of. */
export interface CompareFlags {
  /** Layer or channel of OpenEXR files to compare, such as albedo or depth.Z */
  layer?: string | number | readonly (string | number)[] | undefined;
  /** Exit with 1 if relMSE is larger than this, or A has values that are not finite */
  max_relmse?: number | string | undefined;
  /** Exit with 1 if the mean FLIP error is larger than this */
  max_flip?: number | string | undefined;
  /** Exit with 1 if the bias of a channel has a larger |z| than this; both pictures need the variance AOV */
  max_z?: number | string | undefined;
}

/** Flags of `bismar look`, which the texts speak of. */
export interface LookFlags {
  /** The file's scene, by name or index [default: the file's default scene] */
  scene?: string | number | readonly (string | number)[] | undefined;
  /** Material variant (KHR_materials_variants), by name or index [default: the default materials] */
  variant?: string | number | readonly (string | number)[] | undefined;
  /** Time of the animations, in seconds [default: the rest pose, without animations] */
  pose?: number | string | undefined;
  /** Time of the animations, in frames of --fps from 0 */
  frame?: number | string | undefined;
  /** Frames per second, for --frame, --frames and --shutter */
  fps?: number | string | undefined;
  /** Animation to play, by name or index, or all: every animation at once [default: all] */
  animation?: string | number | readonly (string | number)[] | undefined;
  /** Motion blur: shutter opening and closing time in frames of --fps, relative to the time shown, as in -0.25,0.25 [default: no motion blur] */
  shutter?: string | number | readonly (string | number)[] | undefined;
  /** Number of linear motion segments while the shutter is open, 1 to 128 [default: chosen by the motion's curvature] */
  motion_steps?: number | string | undefined;
  /** Views, separated by commas [default: front, three-quarters, side, and top of a scene that is less than half as high as it is wide and deep, else back; of folders three-quarters] */
  views?: "front" | "three-quarters" | "side" | "back" | "top" | "left" | "bottom" | readonly ("front" | "three-quarters" | "side" | "back" | "top" | "left" | "bottom")[] | undefined;
  /** Size of a view in pixels */
  size?: string | number | readonly (string | number)[] | undefined;
  /** Paths per pixel */
  spp?: number | string | undefined;
  /** For two scenes: exit with 1 if the mean FLIP error of a view is larger than this */
  max_flip?: number | string | undefined;
  /** Number of threads [default: BISMAR_THREADS, else SLURM_CPUS_PER_TASK, else all cores] */
  threads?: number | string | undefined;
  /** Memory limit, such as 900M or 6G [default: Slurm's limit, else the machine's memory] */
  memory_limit?: number | string | undefined;
}

export interface RenderOptions extends RenderFlags, Abort {
  /** Called about once a second. If it throws, the call is aborted and rejects with that error. */
  progress?: ((progress: Progress) => void) | undefined;
}

/** Renders a scene, a .gltf or .glb by its path or the bytes of a GLB, to a PNG, or an OpenEXR file with `format: "exr"`. */
export function render(scene: Input, options?: RenderOptions & { format?: "png" | undefined }): Promise<Result & { png: Uint8Array }>;
export function render(scene: Input, options: RenderOptions & { format: "exr" }): Promise<Result & { exr: Uint8Array }>;

/** What `bismar inspect --json` prints. */
export function inspect(scene: Input, options?: InspectFlags & Abort): Promise<Record<string, any>>;

/** What `bismar compare --json` prints of a picture and a reference: `rel_mse`, `flip`, `bias` and others. */
export function compare(a: Input, b: Input, options?: CompareFlags & Abort): Promise<Record<string, any>>;

/** A contact sheet of scenes, and what `bismar look` prints. */
export function look(
  scenes: Input | readonly Input[],
  options?: LookFlags & Abort,
): Promise<{ png: Uint8Array; report: any; warnings: string[] }>;

/** The path of the program. Throws a BismarError where there is none for this platform. */
export function program(): string;

export const version: string;

/** A call that failed. */
export class BismarError extends Error {
  constructor(message: string, exitCode: number, warnings?: string[]);
  /** The program's: 64 wrong usage, 65 a file that cannot be used, 66 one that is missing, 76 this machine; docs/exit-codes.md. */
  exitCode: number;
  warnings: string[];
}
