//! From a hit to a point on a surface: position, normals, material parameters.

use glam::{Affine3A, Mat3, Vec2, Vec3, Vec4};

use super::materials;
use crate::bsdf::{Anisotropy, Core, Surface};
use crate::lanes::{F, LANES, V3, eight};
use crate::light::AreaLights;
use crate::sampling::warp;
use crate::scene::{Material, Mesh, Scene, TextureRef, TextureSlot};

/// How far ray origins stand off their surface, as a share of the largest coordinate involved: some sixteen roundings.
const ORIGIN_OFFSET: f32 = 16.0 * f32::EPSILON;

/// Instances' normal matrices.
#[derive(Debug)]
pub struct Geometry {
    instances: Vec<Option<Placed>>,
    /// Does anything in the scene move while the shutter is open? Else rays have no times.
    pub moves: bool,
    /// Is it known where things are a frame before and after?
    pub has_velocities: bool,
}

#[derive(Debug, Clone, Copy)]
struct Placed {
    /// To world space.
    linear: Mat3,
    translation: Vec3,
    /// Inverse transpose, times the sign of the determinant: outward normals stay outward for the winding.
    normal: Mat3,
}

impl Placed {
    const NOWHERE: Self = Self { linear: Mat3::IDENTITY, translation: Vec3::ZERO, normal: Mat3::IDENTITY };

    fn new(transform: Affine3A) -> Self {
        let linear = Mat3::from(transform.matrix3);
        let normal = linear.inverse().transpose() * linear.determinant().signum();
        Self { linear, translation: transform.translation.into(), normal }
    }
}

/// Eight points on surfaces that need no texture, before it is known from which side they are seen.
#[derive(Debug, Clone, Copy)]
pub struct Points {
    /// World space.
    pub position: V3,
    /// As in [`Point`].
    pub ng: V3,
    /// Interpolated; otherwise as in [`Point`].
    pub ns: V3,
    /// As in [`Point`].
    pub origin_offset: F,
}

/// A point on a surface, before it is known from which side it is seen.
#[derive(Debug, Clone, Copy)]
pub struct Point<'a> {
    /// World space.
    pub position: Vec3,
    /// Geometric normal on the side that the winding calls the front; any length.
    pub ng: Vec3,
    /// Shading normal on the same side, interpolated and mapped; any length.
    pub ns: Vec3,
    /// Unit normal of the coat on the same side; zero where it is the shading normal, or there is no coat.
    coat: Vec3,
    /// Unit direction along the surface in which it is rougher; zero if it has none.
    rough: Vec3,
    /// How far along the geometric normal rays begin.
    pub origin_offset: f32,
    /// Interpolated texture coordinates of both sets.
    pub texcoords: [Vec2; 2],
    /// Interpolated vertex colour.
    color: Vec4,
    /// The material.
    pub material: &'a Material,
    /// The mesh.
    pub mesh: &'a Mesh,
}

impl Geometry {
    /// Prepares a scene's instances.
    pub fn new(scene: &Scene) -> Self {
        let instances = scene.instances.iter().map(|instance| instance.transform.map(Placed::new)).collect();
        Self { instances, moves: scene.moves(), has_velocities: scene.has_velocities() }
    }

    /// The surfaces at eight hits, none of which moves, without normal maps: `u`, `v` as for [`point`](Self::point).
    #[inline(always)]
    pub fn points(
        &self,
        scene: &Scene,
        instance: [u32; LANES],
        mesh: [u32; LANES],
        prim: [u32; LANES],
        (u, v): (F, F),
    ) -> Points {
        let meshes = eight(|lane| &scene.meshes[mesh[lane] as usize]);
        let indices = eight(|lane| meshes[lane].indices[prim[lane] as usize]);
        let corner = |k: usize| {
            let mut columns = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let p = meshes[lane].positions[indices[lane][k] as usize];
                (columns[0][lane], columns[1][lane], columns[2][lane]) = (p[0], p[1], p[2]);
            }
            V3::from_arrays(columns)
        };
        let a = corner(0);
        let (mut e1, mut e2) = (corner(1) - a, corner(2) - a);
        let mut position = a + e1 * u + e2 * v;
        let mut ng = e1.cross(e2);
        let mut ns = ng;
        if meshes.iter().any(|m| m.normals.is_some()) {
            let normal = |k: usize| {
                let mut columns = [[0.0; LANES]; 3];
                for lane in 0..LANES {
                    if let Some(normals) = &meshes[lane].normals {
                        let n = normals[indices[lane][k] as usize];
                        (columns[0][lane], columns[1][lane], columns[2][lane]) = (n[0], n[1], n[2]);
                    }
                }
                V3::from_arrays(columns)
            };
            let a = normal(0);
            let interpolated = a + (normal(1) - a) * u + (normal(2) - a) * v;
            ns = V3::select(interpolated.length_squared().simd_gt(F::ZERO), interpolated, ng);
        }
        let placed = eight(|lane| self.instances[instance[lane] as usize].as_ref());
        if placed.iter().any(Option::is_some) {
            let placed = eight(|lane| placed[lane].unwrap_or(&Placed::NOWHERE));
            let columns =
                |m: fn(&Placed) -> &Mat3| [0, 1, 2].map(|axis| V3::gather(eight(|lane| m(placed[lane]).col(axis))));
            let transform = |[x, y, z]: &[V3; 3], p: V3| *x * p.x + *y * p.y + *z * p.z;
            let (linear, normal) = (columns(|p| &p.linear), columns(|p| &p.normal));
            position = transform(&linear, position) + V3::gather(eight(|lane| placed[lane].translation));
            (e1, e2) = (transform(&linear, e1), transform(&linear, e2));
            (ng, ns) = (transform(&normal, ng), transform(&normal, ns));
        }
        let size = |v: V3| v.abs().max_element();
        let extent = size(position).fast_max(size(e1)).fast_max(size(e2));
        Points { position, ng, ns, origin_offset: extent * F::splat(ORIGIN_OFFSET) }
    }

    /// The surface at a hit: barycentric weights `u`, `v` of the second and third vertex of triangle `prim`, at a time in
    /// [0, 1] of the shutter.
    #[inline]
    pub fn point<'a>(
        &self,
        scene: &'a Scene,
        (instance, mesh, prim): (u32, u32, u32),
        (u, v): (f32, f32),
        time: f32,
    ) -> Point<'a> {
        let mesh = &scene.meshes[mesh as usize];
        let material = &scene.materials[mesh.material as usize];
        let vertices = mesh.indices[prim as usize];
        let index = vertices.map(|i| i as usize);
        let deformed = mesh.motion.as_ref();
        let [a, b, c] = match deformed {
            None => index.map(|i| Vec3::from_array(mesh.positions[i])),
            Some(motion) => motion.corners(vertices, time),
        };
        let (mut e1, mut e2) = (b - a, c - a);
        let mut position = a + e1 * u + e2 * v;
        let mut ng = e1.cross(e2);
        let moved = if self.moves { moved(scene, instance, time) } else { None };
        let placed = moved.as_ref().or(self.instances[instance as usize].as_ref());
        if let Some(placed) = placed {
            position = placed.linear * position + placed.translation;
            (e1, e2) = (placed.linear * e1, placed.linear * e2);
            ng = placed.normal * ng;
        }
        let extent = position.abs().max(e1.abs()).max(e2.abs()).max_element();
        let texcoords = std::array::from_fn(|set| match &mesh.texcoords[set] {
            Some(t) => {
                let [a, b, c] = index.map(|i| Vec2::from_array(t[i]));
                a + (b - a) * u + (c - a) * v
            }
            None => Vec2::ZERO,
        });
        let color = match &mesh.colors {
            Some(colors) => {
                let [a, b, c] = index.map(|i| Vec4::from_array(colors[i]));
                a + (b - a) * u + (c - a) * v
            }
            None => Vec4::ONE,
        };

        let mut ns = ng;
        if let Some(normals) = &mesh.normals {
            let still = || index.map(|i| Vec3::from_array(normals[i]));
            let [a, b, c] = deformed.and_then(|motion| motion.normals(vertices, time)).unwrap_or_else(still);
            let mut n = a + (b - a) * u + (c - a) * v;
            if let Some(placed) = placed {
                n = placed.normal * n;
            }
            ns = if n.length_squared() > 0.0 { n } else { ng };
        }
        let corner = Corner { scene, mesh, material, placed, index, barycentric: (u, v), texcoords, ns };
        let coated_or_rough = material.clearcoat > 0.0 || material.anisotropy > 0.0;
        let (coat, rough) = if coated_or_rough { corner.coat_and_rough() } else { (Vec3::ZERO, Vec3::ZERO) };
        let ns = corner.mapped(TextureSlot::Normal, material.normal_scale).unwrap_or(ns);
        Point { position, ng, ns, coat, rough, origin_offset: ORIGIN_OFFSET * extent, texcoords, color, material, mesh }
    }
}

/// What is known of a point before its normals are mapped.
struct Corner<'a> {
    scene: &'a Scene,
    mesh: &'a Mesh,
    material: &'a Material,
    placed: Option<&'a Placed>,
    /// Of its triangle's vertices.
    index: [usize; 3],
    barycentric: (f32, f32),
    texcoords: [Vec2; 2],
    /// Interpolated normal, of any length.
    ns: Vec3,
}

impl Corner<'_> {
    #[inline(always)]
    fn texel(&self, map: &TextureRef) -> Vec3 {
        self.scene.sample_texture(map, self.texcoords[usize::from(map.set.min(1))]).truncate()
    }

    /// Tangent, bitangent and normal.
    #[inline(always)]
    fn frame(&self) -> Option<(Vec3, Vec3, Vec3)> {
        let tangents = self.mesh.tangents.as_ref()?;
        let [a, b, c] = self.index.map(|i| Vec4::from_array(tangents[i]));
        let ns = self.ns.normalize_or_zero();
        let (u, v) = self.barycentric;
        let mut tangent = (a + (b - a) * u + (c - a) * v).truncate();
        let mut sign = a.w;
        if let Some(placed) = self.placed {
            tangent = placed.linear * tangent;
            sign *= placed.linear.determinant().signum();
        }
        let tangent = (tangent - ns * ns.dot(tangent)).normalize_or(warp::frame(ns).0);
        Some((tangent, ns.cross(tangent) * sign, ns))
    }

    /// The normal of a map.
    #[inline(always)]
    fn mapped(&self, slot: TextureSlot, scale: f32) -> Option<Vec3> {
        let map = self.material.textures[slot].as_ref()?;
        let (tangent, bitangent, ns) = self.frame()?;
        let n = self.texel(map) * 2.0 - Vec3::ONE;
        Some((tangent * (n.x * scale) + bitangent * (n.y * scale) + ns * n.z).normalize_or(ns))
    }

    /// The coat's normal and the direction of roughness, as in [`Point`]; apart, as few materials have either.
    #[inline(never)]
    fn coat_and_rough(&self) -> (Vec3, Vec3) {
        let Self { material, ns, .. } = self;
        // A coat lies over the bumps of what is beneath.
        let coat = match material.clearcoat > 0.0 && self.mesh.tangents.is_some() {
            true => {
                let mapped = self.mapped(TextureSlot::ClearcoatNormal, material.clearcoat_normal_scale);
                mapped.unwrap_or(ns.normalize_or_zero())
            }
            false => Vec3::ZERO,
        };
        let rough = self.frame().filter(|_| material.anisotropy > 0.0).map(|(tangent, bitangent, _)| {
            let map = material.textures[TextureSlot::Anisotropy].as_ref();
            let along = map.map_or(Vec2::X, |map| self.texel(map).truncate() * 2.0 - Vec2::ONE);
            let along = Vec2::from_angle(material.anisotropy_rotation).rotate(along.normalize_or(Vec2::X));
            tangent * along.x + bitangent * along.y
        });
        (coat, rough.unwrap_or_default())
    }
}

/// How an instance that moves stands at a time.
#[inline(never)]
fn moved(scene: &Scene, instance: u32, time: f32) -> Option<Placed> {
    Some(Placed::new(scene.instances[instance as usize].motion.as_ref()?.at(time)))
}

impl Point<'_> {
    /// Does an emissive material shine here against a ray of this direction? One-sided ones do from their front.
    #[inline]
    pub fn shines_against(&self, direction: Vec3) -> bool {
        self.material.double_sided || self.ng.dot(direction) < 0.0
    }

    /// What it emits against a ray of this direction, where triangle `prim` was hit at `barycentric`.
    #[inline]
    pub fn radiance(&self, scene: &Scene, prim: u32, barycentric: (f32, f32), direction: Vec3) -> Vec3 {
        AreaLights::radiance(scene, self.mesh, prim, barycentric, self.ng.normalize_or_zero().dot(direction))
    }

    /// Does a ray of this direction see its back?
    #[inline]
    pub fn is_behind(&self, direction: Vec3) -> bool {
        self.ng.dot(direction) > 0.0
    }

    /// Base colour with texture and vertex colour.
    #[inline]
    pub fn base_color(&self, scene: &Scene) -> Vec3 {
        let color = (self.material.base_color * self.color).truncate();
        self.texel(scene, TextureSlot::BaseColor).map_or(color, |texel| color * texel.truncate())
    }

    /// The material's parameters here.
    #[inline]
    pub fn parameters(&self, scene: &Scene) -> Surface {
        materials::surface(self.material, self.base_color(scene), |slot| self.texel(scene, slot))
    }

    /// The scattering, where no surface of the scene has more than the core model.
    #[inline(always)]
    pub fn core(&self, scene: &Scene) -> Core {
        materials::core(self.material, self.base_color(scene), |slot| self.texel(scene, slot)).core()
    }

    /// The parameters as a ray of this direction meets them.
    #[inline]
    pub fn seen(&self, scene: &Scene, direction: Vec3) -> Surface {
        let behind = self.is_behind(direction);
        let clearcoat_normal = if behind { -self.coat } else { self.coat };
        let surface = self.parameters(scene);
        let anisotropy = surface.anisotropy.map(|anisotropy| Anisotropy { tangent: self.rough, ..anisotropy });
        Surface { behind, clearcoat_normal, anisotropy, ..surface }
    }

    /// What the material's texture reads here, if there is one.
    #[inline]
    fn texel(&self, scene: &Scene, slot: TextureSlot) -> Option<Vec4> {
        let texture = self.material.textures[slot].as_ref()?;
        Some(scene.sample_texture(texture, self.texcoords[usize::from(texture.set.min(1))]))
    }
}
