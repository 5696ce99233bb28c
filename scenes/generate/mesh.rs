//! The shapes that the scenes are built from, in addition to those of [`bismar::scene::build`].

use std::f64::consts::{PI, TAU};

use bismar::scene::build;
pub use bismar::scene::build::{Shape as Mesh, *};
use glam::{DMat3, DQuat, DVec2, DVec3, dvec2, dvec3};

use crate::random::Random;

/// Recomputes smooth normals: the area-weighted mean of the triangles around each vertex.
pub fn smoothed(mut mesh: Mesh) -> Mesh {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        t.iter().for_each(|&i| sums[i as usize] += (b - a).cross(c - a));
    }
    mesh.normals = sums.into_iter().map(DVec3::normalize).collect();
    mesh
}

fn push(mesh: &mut Mesh, position: DVec3, normal: DVec3) -> u32 {
    mesh.positions.push(position);
    mesh.normals.push(normal);
    mesh.positions.len() as u32 - 1
}

/// A rectangle that carries a picture: `x` points to its right, `y` to its top, and it repeats by `repeat` over their
/// whole length. Faces `x` × `y`.
pub fn textured_rectangle(corner: DVec3, x: DVec3, y: DVec3, repeat: DVec2) -> Mesh {
    let steps = [dvec2(0.0, 0.0), dvec2(1.0, 0.0), dvec2(1.0, 1.0), dvec2(0.0, 1.0)];
    Mesh {
        positions: steps.map(|s| corner + x * s.x + y * s.y).into(),
        normals: vec![x.cross(y).normalize(); 4],
        uvs: steps.map(|s| dvec2(s.x, 1.0 - s.y) * repeat).into(),
        tangents: vec![x.normalize(); 4],
        triangles: vec![[0, 1, 2], [0, 2, 3]],
    }
}

/// A square on the ground around the origin, seen from above.
pub fn floor(half: f64) -> Mesh {
    quad([dvec3(-half, 0.0, half), dvec3(half, 0.0, half), dvec3(half, 0.0, -half), dvec3(-half, 0.0, -half)])
}

/// A rectangle of `width` × `height` around `centre` that faces `target`, upright, flat.
pub fn panel(centre: DVec3, target: DVec3, width: f64, height: f64) -> Mesh {
    let normal = (target - centre).normalize();
    let x = DVec3::Y.cross(normal).normalize() * width * 0.5;
    let y = normal.cross(x).normalize() * height * 0.5;
    quad([centre - x - y, centre + x - y, centre + x + y, centre - x + y])
}

/// A box around the origin, flat.
pub fn cuboid(size: DVec3) -> Mesh {
    build::cuboid(size * -0.5, size * 0.5)
}

/// A box around the origin with rounded edges, smooth.
pub fn rounded_box(size: DVec3, radius: f64, steps: u32) -> Mesh {
    let mut mesh = Mesh::default();
    let inner = size * 0.5 - radius;
    // Each face of a cube, bent: the middle of a face stays flat because its vertices share one normal.
    let cuts: Vec<f64> = (0..=steps).map(|i| (f64::from(i) / f64::from(steps) - 1.0) * PI / 4.0).collect();
    let mut line: Vec<(f64, f64)> = cuts.iter().map(|a| (-1.0, a.tan())).collect();
    line.extend(cuts.iter().rev().map(|a| (1.0, -a.tan())));
    for axis in 0..6 {
        let turn = DMat3::from_quat(match axis {
            0 => DQuat::IDENTITY,
            1 => DQuat::from_rotation_y(PI),
            2 => DQuat::from_rotation_y(PI / 2.0),
            3 => DQuat::from_rotation_y(-PI / 2.0),
            4 => DQuat::from_rotation_x(PI / 2.0),
            _ => DQuat::from_rotation_x(-PI / 2.0),
        });
        let first = mesh.positions.len() as u32;
        let n = line.len() as u32;
        for &(side_y, y) in &line {
            for &(side_x, x) in &line {
                let normal = (turn * dvec3(x, y, 1.0)).normalize();
                let anchor = (turn * dvec3(side_x, side_y, 1.0)).round() * inner;
                push(&mut mesh, anchor + normal * radius, normal);
            }
        }
        for row in 0..n - 1 {
            for column in 0..n - 1 {
                let a = first + row * n + column;
                mesh.triangles.extend([[a, a + 1, a + n + 1], [a, a + n + 1, a + n]]);
            }
        }
    }
    mesh
}

/// A body of revolution about +y. `profile` is (radius, y) from below to above as seen on the outside; bends sharper
/// than `crease` degrees stay sharp.
pub fn lathe(profile: &[(f64, f64)], segments: u32, crease: f64) -> Mesh {
    let points: Vec<DVec2> = profile.iter().map(|&(r, y)| dvec2(r, y)).collect();
    let facing: Vec<DVec2> = points.windows(2).map(|p| (p[1] - p[0]).normalize()).map(|d| dvec2(d.y, -d.x)).collect();
    let limit = crease.to_radians().cos();
    let mut mesh = Mesh::default();
    let ring = |mesh: &mut Mesh, p: DVec2, n: DVec2| {
        let first = mesh.positions.len() as u32;
        for j in 0..segments {
            let (sin, cos) = (TAU * f64::from(j) / f64::from(segments)).sin_cos();
            push(mesh, dvec3(p.x * cos, p.y, p.x * sin), dvec3(n.x * cos, n.y, n.x * sin));
        }
        first
    };
    let mut below = None;
    for i in 0..facing.len() {
        let start = below.unwrap_or_else(|| ring(&mut mesh, points[i], facing[i]));
        let next = facing.get(i + 1).copied();
        let smooth = next.filter(|n| n.dot(facing[i]) >= limit);
        let end_normal = smooth.map_or(facing[i], |n| (n + facing[i]).normalize());
        let end = ring(&mut mesh, points[i + 1], end_normal);
        below = smooth.map(|_| end);
        for j in 0..segments {
            let k = (j + 1) % segments;
            if points[i].x > 0.0 {
                mesh.triangles.push([start + j, end + j, start + k]);
            }
            if points[i + 1].x > 0.0 {
                mesh.triangles.push([start + k, end + j, end + k]);
            }
        }
    }
    mesh
}

/// A smooth curve through `points` (Catmull-Rom), `steps` pieces between neighbours: a profile or a path without kinks.
pub fn spline(points: &[DVec3], steps: u32) -> Vec<DVec3> {
    let at = |i: isize| points[i.clamp(0, points.len() as isize - 1) as usize];
    let mut curve = Vec::new();
    for i in 0..points.len() as isize - 1 {
        let (p0, p1, p2, p3) = (at(i - 1), at(i), at(i + 1), at(i + 2));
        for k in 0..steps {
            let t = f64::from(k) / f64::from(steps);
            let (a, b) = (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3, 3.0 * (p1 - p2) + p3 - p0);
            curve.push(0.5 * (2.0 * p1 + (p2 - p0) * t + a * t * t + b * t * t * t));
        }
    }
    curve.push(at(points.len() as isize - 1));
    curve
}

/// [`spline`] for (radius, y) profiles; radii stay ≥ 0.
pub fn profile_spline(points: &[(f64, f64)], steps: u32) -> Vec<(f64, f64)> {
    let points: Vec<_> = points.iter().map(|&(r, y)| dvec3(r, y, 0.0)).collect();
    spline(&points, steps).iter().map(|p| (p.x.max(0.0), p.y)).collect()
}

/// A round tube along a path; `radius` is asked at 0 (start) to 1 (end). An open tube gets flat ends.
pub fn tube(path: &[DVec3], segments: u32, closed: bool, radius: impl Fn(f64) -> f64) -> Mesh {
    let n = path.len();
    let tangent = |i: usize| {
        let (before, after) =
            if closed { ((i + n - 1) % n, (i + 1) % n) } else { (i.saturating_sub(1), (i + 1).min(n - 1)) };
        (path[after] - path[before]).normalize()
    };
    // Frames that turn no more than they must; a closed path's leftover turn is spread along it.
    let mut frames = vec![tangent(0).any_orthonormal_vector()];
    for i in 1..n {
        frames.push(DQuat::from_rotation_arc(tangent(i - 1), tangent(i)) * frames[i - 1]);
    }
    let twist = if closed {
        let back = DQuat::from_rotation_arc(tangent(n - 1), tangent(0)) * frames[n - 1];
        -tangent(0).dot(frames[0].cross(back)).atan2(frames[0].dot(back)) / n as f64
    } else {
        0.0
    };
    let mut mesh = Mesh::default();
    for i in 0..n {
        let r = radius(i as f64 / if closed { n as f64 } else { n as f64 - 1.0 });
        let u = DQuat::from_axis_angle(tangent(i), twist * i as f64) * frames[i];
        let v = tangent(i).cross(u);
        for j in 0..segments {
            let (sin, cos) = (TAU * f64::from(j) / f64::from(segments)).sin_cos();
            let normal = (u * cos + v * sin).normalize();
            push(&mut mesh, path[i] + normal * r, normal);
        }
    }
    for i in 0..if closed { n } else { n - 1 } as u32 {
        let (a, b) = (i * segments, (i + 1) % n as u32 * segments);
        for j in 0..segments {
            let k = (j + 1) % segments;
            mesh.triangles.extend([[a + j, a + k, b + j], [b + j, a + k, b + k]]);
        }
    }
    if !closed {
        for (ring, out) in [(0, -tangent(0)), ((n as u32 - 1) * segments, tangent(n - 1))] {
            let first = mesh.positions.len() as u32;
            for j in 0..segments {
                let corner = mesh.positions[(ring + j) as usize];
                push(&mut mesh, corner, out);
            }
            for j in 1..segments - 1 {
                let (a, b) = if ring == 0 { (j + 1, j) } else { (j, j + 1) };
                mesh.triangles.push([first, first + a, first + b]);
            }
        }
    }
    mesh
}

/// The same surface seen from its other side.
pub fn inside_out(mesh: &Mesh) -> Mesh {
    Mesh {
        triangles: mesh.triangles.iter().map(|&[a, b, c]| [a, c, b]).collect(),
        normals: mesh.normals.iter().map(|n| -*n).collect(),
        ..mesh.clone()
    }
}

/// A ring about +y.
pub fn torus(ring_radius: f64, tube_radius: f64, steps: u32, segments: u32) -> Mesh {
    let path: Vec<_> = (0..steps)
        .map(|i| (TAU * f64::from(i) / f64::from(steps)).sin_cos())
        .map(|(sin, cos)| dvec3(ring_radius * cos, 0.0, ring_radius * sin))
        .collect();
    tube(&path, segments, true, |_| tube_radius)
}

/// An icosahedron, each triangle split in four `splits` times, on the unit sphere; normals are the positions.
pub fn icosphere(splits: u32) -> Mesh {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    // The corners of three golden rectangles.
    let rectangle = [(-1.0, g), (1.0, g), (-1.0, -g), (1.0, -g)];
    let turns: [fn((f64, f64)) -> DVec3; 3] =
        [|(a, b)| dvec3(a, b, 0.0), |(a, b)| dvec3(0.0, a, b), |(a, b)| dvec3(b, 0.0, a)];
    let corners = turns.iter().flat_map(|turn| rectangle.map(turn));
    let mut positions: Vec<DVec3> = corners.map(DVec3::normalize).collect();
    let corners = [
        0, 11, 5, 0, 5, 1, 0, 1, 7, 0, 7, 10, 0, 10, 11, 1, 5, 9, 5, 11, 4, 11, 10, 2, 10, 7, 6, 7, 1, 8, 3, 9, 4, 3,
        4, 2, 3, 2, 6, 3, 6, 8, 3, 8, 9, 4, 9, 5, 2, 4, 11, 6, 2, 10, 8, 6, 7, 9, 8, 1,
    ];
    let mut triangles: Vec<[u32; 3]> = corners.as_chunks().0.to_vec();
    for _ in 0..splits {
        let mut middles = std::collections::BTreeMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    Mesh { normals: positions.clone(), positions, triangles, ..Mesh::default() }
}

/// A pebble: an icosphere pushed about, smooth, roughly of radius 1.
pub fn stone(splits: u32, random: &mut Random) -> Mesh {
    let bumps: Vec<(DVec3, f64)> = (0..7).map(|_| (random.direction(), random.between(-0.25, 0.3))).collect();
    let mut mesh = icosphere(splits);
    for p in &mut mesh.positions {
        let push: f64 = bumps.iter().map(|(d, size)| size * d.dot(*p).max(0.0).powi(3)).sum();
        *p *= (1.0 + push) * dvec3(1.0, 0.62, 0.85);
    }
    smoothed(mesh)
}
