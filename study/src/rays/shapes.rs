//! Generated scenes of any size, where files would be too large or too few: smooth, long and thin, or scattered
//! triangles under a white environment.

use std::f32::consts::{PI, TAU};
use std::str::FromStr;

use bismar::sampling::SplitMix64;
use bismar::scene::{Camera, Environment, Material, Mesh, Scene};
use glam::{Vec3, Vec4, vec3};

/// A generated scene: `sphere:1000000`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Its place in [`KINDS`].
    kind: usize,
    /// Number of triangles in [8, 100 million], including one or two of the ground.
    triangles: u32,
}

/// A kind of triangles by its name, and what makes so many of them.
type Kind = (&'static str, fn(u32) -> Triangles);

const KINDS: [Kind; 3] = [
    // A bumpy ball on a ground: small, well-shaped triangles that touch.
    ("sphere", sphere),
    // Needles a thousand times as long as wide, through one another in all directions.
    ("slivers", slivers),
    // Small leaves in round crowns: nothing touches, rays go anywhere.
    ("foliage", foliage),
];

impl FromStr for Shape {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("'{text}' is not sphere:N, slivers:N or foliage:N with N from 8 to 100000000 triangles");
        let (name, number) = text.split_once(':').ok_or_else(wrong)?;
        let kind = KINDS.iter().position(|(known, _)| *known == name).ok_or_else(wrong)?;
        let triangles = number.parse().ok().filter(|n| (8..=100_000_000).contains(n)).ok_or_else(wrong)?;
        Ok(Self { kind, triangles })
    }
}

/// Uniform on the unit sphere.
fn direction(random: &mut SplitMix64) -> Vec3 {
    let (y, phi) = (2.0 * random.f32() - 1.0, TAU * random.f32());
    let r = (1.0 - y * y).max(0.0).sqrt();
    vec3(r * phi.cos(), y, r * phi.sin())
}

fn in_ball(random: &mut SplitMix64) -> Vec3 {
    direction(random) * random.f32().cbrt()
}

impl Shape {
    /// `sphere`.
    pub fn kind(&self) -> &'static str {
        KINDS[self.kind].0
    }

    /// `sphere-1000000`.
    pub fn name(&self) -> String {
        format!("{}-{}", self.kind(), self.triangles)
    }

    /// Makes it, always the same to the bit on one machine.
    pub fn scene(&self) -> Scene {
        // Spheres and leaves have an even number of triangles; a ground of one makes the whole odd.
        let ground = 2 - self.triangles % 2;
        let (mut vertices, mut indices) = KINDS[self.kind].1(self.triangles - ground);
        let (first, far) = (vertices.len() as u32, 8.0);
        if ground == 2 {
            vertices.extend([[-far, -1.3, far], [far, -1.3, far], [far, -1.3, -far], [-far, -1.3, -far]]);
            indices.extend([[0, 1, 2], [0, 2, 3]].map(|t| t.map(|i| i + first)));
        } else {
            vertices.extend([[-2.0 * far, -1.3, far], [2.0 * far, -1.3, far], [0.0, -1.3, -3.0 * far]]);
            indices.push([0, 1, 2].map(|i| i + first));
        }
        let material = Material {
            name: "grey".into(),
            base_color: Vec4::new(0.7, 0.7, 0.7, 1.0),
            metallic: 0.0,
            double_sided: true,
            ..Material::default()
        };
        let environment = Some(Environment::constant([1.0; 3]));
        let mut scene = Scene { environment, ..Scene::default() };
        scene.add(Mesh { name: self.name(), ..Mesh::new(vertices, indices) }, material);
        scene.cameras.push(Camera::look_at(vec3(1.6, 1.1, 3.2), vec3(0.0, -0.1, 0.0), 0.7));
        scene
    }
}

type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// `n` triangles, an even number: rings of about as many vertices as their length asks for, and two poles. A band
/// between two rings has as many triangles as both have vertices.
fn sphere(n: u32) -> Triangles {
    let half = n / 2;
    let rows = ((f64::from(half) * std::f64::consts::FRAC_PI_4).sqrt().round() as u32).saturating_sub(1).max(1);
    // Three a ring, and the others by the rings' lengths.
    let others = f64::from(half - 3 * rows);
    let before =
        |i: u32| (0.5 * others * (1.0 - (f64::from(i) / f64::from(rows) * std::f64::consts::PI).cos())).round();
    let rings = (0..rows).map(|i| 3 + (before(i + 1) - before(i)) as u32);
    let rings = std::iter::once(1).chain(rings).chain([1]).collect::<Vec<_>>();
    let mut vertices = Vec::with_capacity(half as usize + 2);
    for (i, &ring) in rings.iter().enumerate() {
        for j in 0..ring {
            let (theta, phi) = (i as f32 / (rows + 1) as f32 * PI, j as f32 / ring as f32 * TAU);
            let bumps =
                0.12 * (9.0 * phi).sin() * (7.0 * theta).sin() + 0.03 * (53.0 * phi).sin() * (47.0 * theta).sin();
            let unit = vec3(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin());
            vertices.push((unit * (1.0 + bumps)).to_array());
        }
    }
    let mut indices = Vec::with_capacity(n as usize);
    let mut first = 0;
    for pair in rings.windows(2) {
        let ([upper, lower], second) = ([pair[0], pair[1]], first + pair[0]);
        let (top, bottom) = (|i: u32| first + i % upper, |j: u32| second + j % lower);
        // A pole has a vertex but no edges.
        let edges = |ring: u32| if ring == 1 { 0 } else { ring };
        let (mut i, mut j) = (0, 0);
        while i < edges(upper) || j < edges(lower) {
            let below = j < edges(lower)
                && (i == edges(upper) || u64::from(j + 1) * u64::from(upper) <= u64::from(i + 1) * u64::from(lower));
            if below {
                indices.push([top(i), bottom(j + 1), bottom(j)]);
                j += 1;
            } else {
                indices.push([top(i), top(i + 1), bottom(j)]);
                i += 1;
            }
        }
        first = second;
    }
    (vertices, indices)
}

fn apart(vertices: Vec<[f32; 3]>) -> Triangles {
    let n = vertices.len() as u32 / 3;
    (vertices, (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

fn slivers(n: u32) -> Triangles {
    let mut random = SplitMix64(1);
    // About as much surface however many there are.
    let length = 1.0_f32.min(30.0 / (n as f32).sqrt());
    let needle = |_| {
        let (middle, along) = (in_ball(&mut random), direction(&mut random) * length);
        let across = along.cross(direction(&mut random)) * 1e-3;
        [middle - along * 0.5, middle + along * 0.5, middle - along * 0.5 + across].map(|p| p.to_array())
    };
    apart((0..n).flat_map(needle).collect())
}

/// Leaves of two triangles in 27 crowns.
fn foliage(n: u32) -> Triangles {
    let mut random = SplitMix64(2);
    let crowns = (0..27).map(|i| vec3((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0).collect::<Vec<_>>();
    let size = 1.6 / (n as f32 / 2.0).sqrt().max(4.0);
    let leaf = |i: u32| {
        let middle = (crowns[i as usize % crowns.len()] + 0.45 * in_ball(&mut random)) * 0.8;
        let along = direction(&mut random) * size;
        let across = along.cross(direction(&mut random)).normalize_or(Vec3::X) * (0.4 * size);
        let [a, b, c, d] = [-along, across, along, -across].map(|p| (middle + p).to_array());
        [a, b, c, a, c, d]
    };
    apart((0..n / 2).flat_map(leaf).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_have_exactly_the_triangles_that_were_requested_and_sound_vertices() {
        for (kind, (name, _)) in KINDS.into_iter().enumerate() {
            for n in (8..100).chain([1000, 4999, 50_000]) {
                let shape = format!("{name}:{n}").parse::<Shape>().unwrap();
                assert_eq!(shape, Shape { kind, triangles: n });
                let scene = shape.scene();
                let mesh = &scene.meshes[0];
                assert_eq!(mesh.indices.len(), n as usize, "{name}");
                assert!(mesh.indices.iter().flatten().all(|i| (*i as usize) < mesh.positions.len()));
                assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
                let corners = |t: &[u32; 3]| t.map(|i| Vec3::from(mesh.positions[i as usize]));
                let area = |[a, b, c]: [Vec3; 3]| (b - a).cross(c - a).length();
                assert!(mesh.indices.iter().map(corners).all(|t| area(t) > 0.0), "{name}:{n}");
            }
        }
        for wrong in ["sphere", "sphere:7", "sphere:x", "cube:100", "sphere:100000001"] {
            assert!(wrong.parse::<Shape>().unwrap_err().contains(wrong), "{wrong}");
        }
    }

    #[test]
    fn a_sphere_is_closed() {
        for n in [6, 10, 98, 5000] {
            let (vertices, indices) = sphere(n);
            let mut edges = indices.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]).collect::<Vec<_>>();
            edges.sort_unstable();
            // Each edge once in each direction, and Euler's formula.
            for pair in edges.windows(2) {
                assert_ne!(pair[0], pair[1], "{n}");
            }
            assert!(edges.iter().all(|[a, b]| edges.binary_search(&[*b, *a]).is_ok()), "{n}");
            assert_eq!(vertices.len() + indices.len(), edges.len() / 2 + 2);
        }
    }
}
