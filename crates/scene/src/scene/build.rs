//! Builds small scenes in code: shapes, materials and a camera.
//!
//! ```
//! use bismar_scene::scene::{Scene, build};
//! use glam::DVec3;
//!
//! let mut scene = Scene::default();
//! build::add_shape(&mut scene, &build::sphere(0.5, 16), build::metal(0.3));
//! let above = build::quad([[-1.0, 2.0, -1.0], [1.0, 2.0, -1.0], [1.0, 2.0, 1.0], [-1.0, 2.0, 1.0]].map(DVec3::from));
//! build::add_shape(&mut scene, &above, build::area_light(5.0));
//! build::look(&mut scene, [0.0, 1.0, 4.0], [0.0; 3], 0.6);
//! ```

use std::f64::consts::{PI, TAU};

use glam::{DAffine3, DQuat, DVec2, DVec3, Vec3, Vec4, dvec3};

use super::{Camera, Material, Mesh, Scene};

/// A triangle mesh in double precision, in metres. Counter-clockwise triangles face outwards.
#[derive(Debug, Clone, Default)]
pub struct Shape {
    pub positions: Vec<DVec3>,
    /// One unit normal per vertex, or none: the triangles are flat.
    pub normals: Vec<DVec3>,
    /// One texture coordinate per vertex, or none.
    pub uvs: Vec<DVec2>,
    /// One direction of growing u per vertex, for normal maps; or none.
    pub tangents: Vec<DVec3>,
    /// Indices of vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl Shape {
    /// Applies a transform that keeps handedness. Tangents stay as they are.
    pub fn transformed(mut self, transform: DAffine3) -> Self {
        let normals = transform.matrix3.inverse().transpose();
        self.positions.iter_mut().for_each(|p| *p = transform.transform_point3(*p));
        self.normals.iter_mut().for_each(|n| *n = (normals * *n).normalize());
        self
    }

    /// Scales about the origin.
    pub fn scaled(self, factor: f64) -> Self {
        self.transformed(DAffine3::from_scale(DVec3::splat(factor)))
    }

    /// Moves by an offset in metres.
    pub fn translated(self, offset: DVec3) -> Self {
        self.transformed(DAffine3::from_translation(offset))
    }

    /// Rotates about the origin.
    pub fn rotated(self, rotation: DQuat) -> Self {
        self.transformed(DAffine3::from_quat(rotation))
    }

    /// Appends another shape, which must have the same kinds of vertex data. Tangents are not appended.
    pub fn and(mut self, other: &Shape) -> Self {
        let first = self.positions.len() as u32;
        self.positions.extend(&other.positions);
        self.normals.extend(&other.normals);
        self.uvs.extend(&other.uvs);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + first)));
        self
    }
}

/// A flat quadrilateral with counter-clockwise corners.
pub fn quad(corners: [DVec3; 4]) -> Shape {
    Shape { positions: corners.into(), triangles: vec![[0, 1, 2], [0, 2, 3]], ..Shape::default() }
}

/// An axis-aligned box between two corners, with flat faces.
pub fn cuboid(low: DVec3, high: DVec3) -> Shape {
    let corner = |i: u32| DVec3::from_array([0, 1, 2].map(|axis| [low, high][(i >> axis & 1) as usize][axis]));
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    faces.iter().fold(Shape::default(), |all, face| all.and(&quad(face.map(corner))))
}

/// A smooth sphere around the origin with `rings` bands of latitude, each of `2 * rings` columns.
pub fn sphere(radius: f64, rings: u32) -> Shape {
    let (mut shape, columns) = (Shape::default(), 2 * rings);
    for i in 0..=rings {
        let (sin, cos) = if i == rings { (0.0, -1.0) } else { (PI * f64::from(i) / f64::from(rings)).sin_cos() };
        let (r, y) = (radius * sin, -radius * cos);
        for j in 0..columns {
            let (sin, cos) = (TAU * f64::from(j) / f64::from(columns)).sin_cos();
            shape.positions.push(dvec3(r * cos, y, r * sin));
        }
        for j in (0..columns).filter(|_| i > 0) {
            let ([below, above], next) = ([(i - 1) * columns, i * columns], (j + 1) % columns);
            if i > 1 {
                shape.triangles.push([below + j, above + j, below + next]);
            }
            if i < rings {
                shape.triangles.push([below + next, above + j, above + next]);
            }
        }
    }
    shape.normals = shape.positions.iter().map(|p| p.normalize()).collect();
    shape
}

/// A Lambertian material without a specular layer.
pub fn lambert(albedo: f32) -> Material {
    Material { base_color: Vec4::new(albedo, albedo, albedo, 1.0), metallic: 0.0, specular: 0.0, ..Default::default() }
}

/// A white metal of a perceptual roughness in [0, 1].
pub fn metal(roughness: f32) -> Material {
    Material { metallic: 1.0, roughness, ..Default::default() }
}

/// The boundary of a medium of clear glass, of an index of refraction and a perceptual roughness in [0, 1].
pub fn glass(ior: f32, roughness: f32) -> Material {
    Material { metallic: 0.0, roughness, ior, transmission: 1.0, bounds_medium: true, ..Default::default() }
}

/// A black emitter of a radiance that is equal in all channels. It emits from its front side only.
pub fn area_light(radiance: f32) -> Material {
    Material { emissive: Vec3::splat(radiance), ..lambert(0.0) }
}

/// Adds a shape with its own material, object and instance. Normals are kept; texture coordinates and tangents are not.
pub fn add_shape(scene: &mut Scene, shape: &Shape, material: Material) {
    let floats = |v: &DVec3| v.as_vec3().to_array();
    let normals = (!shape.normals.is_empty()).then(|| shape.normals.iter().map(floats).collect());
    let positions = shape.positions.iter().map(floats).collect();
    scene.add(Mesh { normals, ..Mesh::new(positions, shape.triangles.clone()) }, material);
}

/// Adds the camera of [`Camera::look_at`].
pub fn look(scene: &mut Scene, eye: impl Into<Vec3>, target: impl Into<Vec3>, yfov: f32) {
    scene.cameras.push(Camera::look_at(eye.into(), target.into(), yfov));
}
