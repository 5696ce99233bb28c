//! From a hit to a point on a surface: position, normals, material parameters.

use glam::{Affine3A, Mat2, Mat3, Vec2, Vec3, Vec4};

use super::materials;
use crate::bsdf::{Anisotropy, Core, Surface};
use crate::lanes::{F, LANES, V3, eight};
use crate::light::AreaLights;
use crate::sampling::warp;
use crate::scene::Primitive;
use crate::scene::{Material, Mesh, Scene, TextureRef, TextureSlot};

/// Offset of ray origins from their surface relative to the largest coordinate involved: sixteen roundings.
const ORIGIN_OFFSET: f32 = crate::light::samples::ROUNDING;

/// Instance transforms, prepared for shading.
#[derive(Debug)]
pub struct Geometry {
    instances: Vec<Option<ShadingTransform>>,
    /// Does anything move while the shutter is open? Else rays carry no times.
    pub moves: bool,
    /// Are positions in the previous and next frame known?
    pub has_velocities: bool,
}

#[derive(Debug, Clone, Copy)]
struct ShadingTransform {
    /// Linear part of object to world.
    linear: Mat3,
    translation: Vec3,
    /// Normal matrix: the inverse transpose. Where the transform mirrors, the front is where the winding is clockwise, as glTF has
    /// it.
    normal: Mat3,
}

impl ShadingTransform {
    const IDENTITY: Self = Self { linear: Mat3::IDENTITY, translation: Vec3::ZERO, normal: Mat3::IDENTITY };

    fn new(transform: Affine3A) -> Self {
        let linear = Mat3::from(transform.matrix3);
        Self { linear, translation: transform.translation.into(), normal: linear.inverse().transpose() }
    }
}

/// Eight surface points without textures, independent of the viewing direction.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoints {
    /// World space.
    pub position: V3,
    /// Geometric normals on the front side, world space, any length.
    pub ng: V3,
    /// Interpolated shading normals on the same side, any length.
    pub ns: V3,
    /// Offset of ray origins along the geometric normal, in metres.
    pub origin_offset: F,
}

/// A surface point, independent of the viewing direction.
#[derive(Debug, Clone, Copy)]
pub struct SurfacePoint<'a> {
    /// World space.
    pub position: Vec3,
    /// Geometric normal on the front side, world space, any length.
    pub ng: Vec3,
    /// Shading normal on the same side, interpolated and normal-mapped, any length.
    pub ns: Vec3,
    /// Unit normal of the clear coat on the same side; zero where it is the shading normal or there is no coat.
    coat_normal: Vec3,
    /// Unit direction of the higher roughness; zero if roughness is isotropic.
    anisotropy_tangent: Vec3,
    /// Offset of ray origins along the geometric normal, in metres.
    pub origin_offset: f32,
    /// Interpolated texture coordinates of TEXCOORD_0 and TEXCOORD_1.
    pub texcoords: [Vec2; 2],
    /// Index of the triangle in the mesh.
    prim: u32,
    /// Barycentric weights of the triangle's second and third vertex.
    barycentric: (f32, f32),
    color: Vec4,
    pub material: &'a Material,
    pub mesh: &'a Mesh,
}

impl Geometry {
    /// Prepares the instances of a scene.
    pub fn new(scene: &Scene) -> Self {
        let instances = scene.instances.iter().map(|instance| instance.transform.map(ShadingTransform::new)).collect();
        Self { instances, moves: scene.moves(), has_velocities: scene.has_velocities() }
    }

    /// The surface points at eight hits on static geometry without normal maps; `u` and `v` are the barycentric weights of the
    /// second and third vertex.
    #[inline(always)]
    pub fn points(
        &self,
        scene: &Scene,
        instance: [u32; LANES],
        mesh: [u32; LANES],
        prim: [u32; LANES],
        (u, v): (F, F),
    ) -> SurfacePoints {
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
        let transform = eight(|lane| self.instances[instance[lane] as usize].as_ref());
        if transform.iter().any(Option::is_some) {
            let transform = eight(|lane| transform[lane].unwrap_or(&ShadingTransform::IDENTITY));
            let columns = |m: fn(&ShadingTransform) -> &Mat3| {
                [0, 1, 2].map(|axis| V3::gather(eight(|lane| m(transform[lane]).col(axis))))
            };
            let apply = |[x, y, z]: &[V3; 3], p: V3| *x * p.x + *y * p.y + *z * p.z;
            let (linear, normal) = (columns(|p| &p.linear), columns(|p| &p.normal));
            position = apply(&linear, position) + V3::gather(eight(|lane| transform[lane].translation));
            (e1, e2) = (apply(&linear, e1), apply(&linear, e2));
            (ng, ns) = (apply(&normal, ng), apply(&normal, ns));
        }
        let size = |v: V3| v.abs().max_element();
        let extent = size(position).fast_max(size(e1)).fast_max(size(e2));
        SurfacePoints { position, ng, ns, origin_offset: extent * F::splat(ORIGIN_OFFSET) }
    }

    /// The geometric normal of triangle `prim`, in world space and of any length, on the front side. `time` is
    /// in [0, 1] of the shutter interval.
    #[inline]
    pub fn normal(&self, scene: &Scene, Primitive { instance, mesh, prim }: Primitive, time: f32) -> Vec3 {
        let mesh = &scene.meshes[mesh as usize];
        let vertices = mesh.indices[prim as usize];
        let [a, b, c] = match &mesh.motion {
            None => vertices.map(|i| Vec3::from_array(mesh.positions[i as usize])),
            Some(motion) => motion.corners(vertices, time),
        };
        let ng = (b - a).cross(c - a);
        let moving_transform = if self.moves { moving_transform(scene, instance, time) } else { None };
        let transform = moving_transform.as_ref().or(self.instances[instance as usize].as_ref());
        transform.map_or(ng, |transform| transform.normal * ng)
    }

    /// The surface point at a hit on triangle `prim`; `u` and `v` are the barycentric weights of its second and third vertex,
    /// `time` is in [0, 1] of the shutter interval.
    #[inline]
    pub fn point<'a>(
        &self,
        scene: &'a Scene,
        Primitive { instance, mesh, prim }: Primitive,
        (u, v): (f32, f32),
        time: f32,
    ) -> SurfacePoint<'a> {
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
        let moving_transform = if self.moves { moving_transform(scene, instance, time) } else { None };
        let transform = moving_transform.as_ref().or(self.instances[instance as usize].as_ref());
        if let Some(transform) = transform {
            position = transform.linear * position + transform.translation;
            (e1, e2) = (transform.linear * e1, transform.linear * e2);
            ng = transform.normal * ng;
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
            let static_normals = || index.map(|i| Vec3::from_array(normals[i]));
            let [a, b, c] = deformed.and_then(|motion| motion.normals(vertices, time)).unwrap_or_else(static_normals);
            let mut n = a + (b - a) * u + (c - a) * v;
            if let Some(transform) = transform {
                n = transform.normal * n;
            }
            ns = if n.length_squared() > 0.0 { n } else { ng };
        }
        let corner = Interpolated {
            scene,
            mesh,
            material,
            transform,
            prim,
            index,
            barycentric: (u, v),
            edges: (e1, e2),
            texcoords,
            ns,
        };
        let coated_or_anisotropic = material.clearcoat > 0.0 || material.anisotropy > 0.0;
        let (coat_normal, anisotropy_tangent) =
            if coated_or_anisotropic { corner.coat_normal_and_tangent() } else { (Vec3::ZERO, Vec3::ZERO) };
        let ns = corner.mapped_normal(TextureSlot::Normal, material.normal_scale).unwrap_or(ns);
        SurfacePoint {
            position,
            ng,
            ns,
            coat_normal,
            anisotropy_tangent,
            origin_offset: ORIGIN_OFFSET * extent,
            texcoords,
            prim,
            barycentric: (u, v),
            color,
            material,
            mesh,
        }
    }
}

/// A surface point before normal mapping.
struct Interpolated<'a> {
    scene: &'a Scene,
    mesh: &'a Mesh,
    material: &'a Material,
    transform: Option<&'a ShadingTransform>,
    /// Index of the triangle in the mesh.
    prim: u32,
    /// Vertex indices of the triangle.
    index: [usize; 3],
    barycentric: (f32, f32),
    /// From the triangle's first corner to the second and third, world space.
    edges: (Vec3, Vec3),
    texcoords: [Vec2; 2],
    /// Interpolated normal, of any length.
    ns: Vec3,
}

impl Interpolated<'_> {
    #[inline(always)]
    fn texel(&self, map: &TextureRef) -> Vec3 {
        let at = map.select(&self.texcoords).copied();
        let at = at.unwrap_or_else(|| self.mesh.texcoord(map, self.prim, self.barycentric));
        self.scene.sample_texture(map, at).truncate()
    }

    /// Unit tangent, bitangent and shading normal in world space by these tangents of the mesh, those of the coordinates that
    /// `map` transforms; `None` without tangents.
    #[inline(always)]
    fn frame(&self, tangents: Option<&[[f32; 4]]>, map: Option<&TextureRef>) -> Option<(Vec3, Vec3, Vec3)> {
        let tangents = tangents?;
        let [a, b, c] = self.index.map(|i| Vec4::from_array(tangents[i]));
        let ns = self.ns.normalize_or_zero();
        let (u, v) = self.barycentric;
        let mut tangent = (a + (b - a) * u + (c - a) * v).truncate();
        let mut sign = a.w;
        if let Some(transform) = self.transform {
            tangent = transform.linear * tangent;
            sign *= transform.linear.determinant().signum();
        }
        let tangent = (tangent - ns * ns.dot(tangent)).normalize_or(warp::frame(ns).0);
        let bitangent = ns.cross(tangent) * sign;
        match map.and_then(|map| Some((map, map.transform?.matrix2))) {
            Some((map, matrix)) if matrix.x_axis.y != 0.0 || matrix.x_axis.x <= 0.0 || matrix.determinant() <= 0.0 => {
                Some(self.turned((tangent, bitangent, ns), map, matrix))
            }
            _ => Some((tangent, bitangent, ns)),
        }
    }

    /// The frame of texture coordinates that `matrix` transforms, from that of the coordinates before: turned as the triangle's
    /// derivative by u is. The bitangent points against v, which runs down.
    #[inline(never)]
    fn turned(
        &self,
        (tangent, bitangent, ns): (Vec3, Vec3, Vec3),
        map: &TextureRef,
        matrix: Mat2,
    ) -> (Vec3, Vec3, Vec3) {
        let [a, b, c] = self.mesh.corner_texcoords(map, self.mesh.indices[self.prim as usize]);
        let ((e1, e2), (d1, d2)) = (self.edges, (b - a, c - a));
        let sides = d1.perp_dot(d2).signum();
        let (by_u, by_v) = ((e1 * d2.y - e2 * d1.y) * sides, (e2 * d1.x - e1 * d2.x) * sides);
        let t = by_u.normalize_or_zero();
        let across = t * t.dot(by_v) - by_v;
        // Where the triangle has no coordinates, as if they were even.
        let (u, v) = match across.length() {
            length if length > 0.0 && t != Vec3::ZERO => {
                (Vec2::new(by_u.length(), 0.0), Vec2::new(t.dot(by_v), -length))
            }
            _ => (Vec2::X, Vec2::NEG_Y),
        };
        let mirror = matrix.determinant().signum();
        // The first column of the inverse, times the determinant.
        let along = (u * matrix.y_axis.y - v * matrix.x_axis.y) * mirror;
        let along = (tangent * along.x + bitangent * along.y).normalize_or(tangent);
        let handed = ns.cross(tangent).dot(bitangent).signum() * mirror;
        (along, ns.cross(along) * handed, ns)
    }

    /// The unit normal that a normal map gives, if there is one.
    #[inline(always)]
    fn mapped_normal(&self, slot: TextureSlot, scale: f32) -> Option<Vec3> {
        let map = self.material.textures[slot].as_ref()?;
        let coat = self.mesh.coat_tangents.as_deref().filter(|_| slot == TextureSlot::ClearcoatNormal);
        let (tangent, bitangent, ns) = self.frame(coat.or(self.mesh.tangents.as_deref()), Some(map))?;
        let n = self.texel(map) * 2.0 - Vec3::ONE;
        Some((tangent * (n.x * scale) + bitangent * (n.y * scale) + ns * n.z).normalize_or(ns))
    }

    /// The coat normal and anisotropy tangent of [`SurfacePoint`]. Not inlined, because few materials have either.
    #[inline(never)]
    fn coat_normal_and_tangent(&self) -> (Vec3, Vec3) {
        let Self { material, ns, .. } = self;
        // The coat has its own normal map; the base's does not apply to it.
        let coat_normal = match material.clearcoat > 0.0 && self.mesh.tangents.is_some() {
            true => {
                let mapped_normal = self.mapped_normal(TextureSlot::ClearcoatNormal, material.clearcoat_normal_scale);
                mapped_normal.unwrap_or(ns.normalize_or_zero())
            }
            false => Vec3::ZERO,
        };
        let map = material.textures[TextureSlot::Anisotropy].as_ref();
        let anisotropy_tangent = self
            .frame(self.mesh.tangents.as_deref(), map)
            .filter(|_| material.anisotropy > 0.0)
            .map(|(tangent, bitangent, _)| {
                let along = map.map_or(Vec2::X, |map| self.texel(map).truncate() * 2.0 - Vec2::ONE);
                let along = Vec2::from_angle(material.anisotropy_rotation).rotate(along.normalize_or(Vec2::X));
                tangent * along.x + bitangent * along.y
            });
        (coat_normal, anisotropy_tangent.unwrap_or_default())
    }
}

/// The transform of a moving instance at a time; `None` for a static one.
#[inline(never)]
fn moving_transform(scene: &Scene, instance: u32, time: f32) -> Option<ShadingTransform> {
    Some(ShadingTransform::new(scene.instances[instance as usize].motion.as_ref()?.at(time)))
}

impl SurfacePoint<'_> {
    /// Does the side that a ray of this direction hits emit? Single-sided materials emit from their front.
    #[inline]
    pub fn emits_against(&self, direction: Vec3) -> bool {
        self.material.double_sided || self.ng.dot(direction) < 0.0
    }

    /// Radiance emitted toward the origin of a ray of this direction.
    #[inline]
    pub fn emitted_radiance(&self, scene: &Scene, direction: Vec3) -> Vec3 {
        AreaLights::radiance(scene, self.mesh, self.prim, self.barycentric, self.ng.normalize_or_zero().dot(direction))
    }

    /// Does a ray of this direction hit the back side?
    #[inline]
    pub fn is_back_facing(&self, direction: Vec3) -> bool {
        self.ng.dot(direction) > 0.0
    }

    /// Linear RGB base colour with texture and vertex colour.
    #[inline]
    pub fn base_color(&self, scene: &Scene) -> Vec3 {
        let color = (self.material.base_color * self.color).truncate();
        self.texel(scene, TextureSlot::BaseColor).map_or(color, |texel| color * texel.truncate())
    }

    /// Material parameters with textures, seen from the front and without tangent.
    #[inline]
    pub fn parameters(&self, scene: &Scene) -> Surface {
        materials::surface(self.material, self.base_color(scene), |slot| self.texel(scene, slot))
    }

    /// The BSDF, for scenes whose materials need only the core model.
    #[inline(always)]
    pub fn core(&self, scene: &Scene) -> Core {
        materials::core(self.material, self.base_color(scene), |slot| self.texel(scene, slot)).core()
    }

    /// Material parameters as seen by a ray of this direction.
    #[inline]
    pub fn surface_from(&self, scene: &Scene, direction: Vec3) -> Surface {
        let back_facing = self.is_back_facing(direction);
        let clearcoat_normal = if back_facing { -self.coat_normal } else { self.coat_normal };
        let surface = self.parameters(scene);
        let anisotropy =
            surface.anisotropy.map(|anisotropy| Anisotropy { tangent: self.anisotropy_tangent, ..anisotropy });
        Surface { back_facing, clearcoat_normal, anisotropy, ..surface }
    }

    /// The texel of a texture slot, if the material has a texture there.
    #[inline]
    fn texel(&self, scene: &Scene, slot: TextureSlot) -> Option<Vec4> {
        let texture = self.material.textures[slot].as_ref()?;
        let at = texture.select(&self.texcoords).copied();
        let at = at.unwrap_or_else(|| self.mesh.texcoord(texture, self.prim, self.barycentric));
        Some(scene.sample_texture(texture, at))
    }
}
