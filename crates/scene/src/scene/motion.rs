//! What moves while the shutter is open: keys at even steps of the time from 0, where it opens, to 1, where it closes.

use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, Mat3, Quat, Vec3};

use super::Positions;

/// Most steps from key to key: Embree has no more.
pub const MOST_STEPS: usize = 128;

/// Largest angle of a step in radians, 3.5°: up to 3.6° Embree joins rotations by lines and makes them unit again, which can
/// be done to the same bits here; beyond, its slerp is off by 1e-5, enough for rays to leave from beneath the surface.
const LARGEST_TURN: f64 = 0.061;

/// The key before a time among `keys` (≥ 2), and how far on the way to the next it is, as Embree has it.
#[inline]
pub fn between(keys: usize, time: f32) -> (usize, f32) {
    let scaled = time * (keys - 1) as f32;
    let before = (scaled as usize).min(keys - 2);
    (before, scaled - before as f32)
}

/// From `a` to `b`.
#[inline]
pub fn mix(a: Vec3, b: Vec3, share: f32) -> Vec3 {
    a * (1.0 - share) + b * share
}

/// A transform that moves.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    keys: Vec<Key>,
    turns: bool,
}

/// A transform: `rotation` after `linear`, then `translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Identity where nothing turns.
    pub rotation: Quat,
    /// Upper triangular where something turns.
    pub linear: Mat3,
    /// Metres.
    pub translation: Vec3,
}

impl Motion {
    /// Through transforms at even steps, at least one, each invertible; `None` if all are the same.
    pub fn new(samples: &[DAffine3]) -> Option<Self> {
        let first = samples.first()?.as_affine3a();
        if samples.iter().all(|m| m.as_affine3a() == first) {
            return None;
        }
        let straight = |m: &DAffine3| Key {
            rotation: Quat::IDENTITY,
            linear: m.matrix3.as_mat3(),
            translation: m.translation.as_vec3(),
        };
        let split: Vec<_> = samples.iter().map(|m| (split(m.matrix3), m.translation)).collect();
        let turn = |pair: &[((DQuat, DMat3), DVec3)]| pair[0].0.0.angle_between(pair[1].0.0);
        let largest = split.windows(2).map(turn).fold(0.0, f64::max);
        let parts = (largest / LARGEST_TURN).ceil().max(1.0) as usize;
        if largest < 1e-9 || parts * (samples.len() - 1) > MOST_STEPS {
            // Faster than that nobody sees that a circle is a polygon.
            return Some(Self { keys: samples.iter().map(straight).collect(), turns: false });
        }
        let mut keys: Vec<Key> = Vec::with_capacity(parts * (samples.len() - 1) + 1);
        let mut add = |rotation: DQuat, linear: DMat3, translation: DVec3| {
            let rotation = rotation.as_quat();
            // The same rotation, on the near side.
            let near = keys.last().is_none_or(|last| last.rotation.dot(rotation) >= 0.0);
            let rotation = if near { rotation } else { -rotation };
            keys.push(Key { rotation, linear: linear.as_mat3(), translation: translation.as_vec3() });
        };
        for pair in split.windows(2) {
            let [((q0, l0), t0), ((q1, l1), t1)] = [pair[0], pair[1]];
            for part in 0..parts {
                let u = part as f64 / parts as f64;
                add(q0.slerp(q1, u), l0 * (1.0 - u) + l1 * u, t0.lerp(t1, u));
            }
        }
        if let Some(((rotation, linear), translation)) = split.last() {
            add(*rotation, *linear, *translation);
        }
        Some(Self { keys, turns: true })
    }

    /// The keys, at least two.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Do rotations join keys? Else matrices are mixed.
    pub fn turns(&self) -> bool {
        self.turns
    }

    /// The transform at a time in [0, 1].
    #[inline]
    pub fn at(&self, time: f32) -> Affine3A {
        let (before, share) = between(self.keys.len(), time);
        let (a, b) = (&self.keys[before], &self.keys[before + 1]);
        let linear = a.linear * (1.0 - share) + b.linear * share;
        let matrix = match self.turns {
            false => linear,
            true => Mat3::from_quat((a.rotation * (1.0 - share) + b.rotation * share).normalize()) * linear,
        };
        Affine3A::from_mat3_translation(matrix, mix(a.translation, b.translation, share))
    }
}

impl Key {
    /// The transform.
    pub fn transform(&self) -> Affine3A {
        Affine3A::from_mat3_translation(Mat3::from_quat(self.rotation) * self.linear, self.translation)
    }
}

/// A matrix as a rotation after an upper triangular one (Gram and Schmidt).
fn split(m: DMat3) -> (DQuat, DMat3) {
    let x = m.x_axis.normalize();
    let y = (m.y_axis - x * x.dot(m.y_axis)).normalize();
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    let mut upper = rotation.transpose() * m;
    (upper.x_axis.y, upper.x_axis.z, upper.y_axis.z) = (0.0, 0.0, 0.0);
    (DQuat::from_mat3(&rotation), upper)
}

/// The vertices of a mesh that changes its form, key by key, at least two.
#[derive(Debug, Clone, Default)]
pub struct Deformation {
    /// As [`Mesh::positions`](super::Mesh::positions).
    pub positions: Vec<Positions>,
    /// As [`Mesh::normals`](super::Mesh::normals); empty where the mesh has none.
    pub normals: Vec<Vec<[f32; 3]>>,
}

impl Deformation {
    /// In memory.
    pub fn bytes(&self) -> usize {
        let positions: usize = self.positions.iter().map(|p| size_of_val(p.padded())).sum();
        positions + self.normals.iter().map(|n| size_of_val(&n[..])).sum::<usize>()
    }

    /// Where three vertices are at a time in [0, 1].
    #[inline]
    pub fn corners(&self, vertices: [u32; 3], time: f32) -> [Vec3; 3] {
        let (before, share) = between(self.positions.len(), time);
        let (a, b) = (&self.positions[before], &self.positions[before + 1]);
        vertices.map(|i| mix(a[i as usize].into(), b[i as usize].into(), share))
    }

    /// Their normals, of any length; `None` where the mesh has none.
    #[inline]
    pub fn normals(&self, vertices: [u32; 3], time: f32) -> Option<[Vec3; 3]> {
        if self.normals.is_empty() {
            return None;
        }
        let (before, share) = between(self.normals.len(), time);
        let (a, b) = (&self.normals[before], &self.normals[before + 1]);
        Some(vertices.map(|i| mix(a[i as usize].into(), b[i as usize].into(), share)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_are_met_at_their_moments_and_turn_on_circles_between() {
        let of = |angle: f64| {
            DAffine3::from_scale_rotation_translation(
                DVec3::new(2.0, -3.0, 0.5),
                DQuat::from_rotation_z(angle),
                DVec3::new(1.0 + angle, 0.0, 0.0),
            )
        };
        let samples = [of(0.0), of(0.4), of(0.8)];
        let motion = Motion::new(&samples).unwrap();
        assert!(motion.turns() && motion.keys().len() == 15, "{}", motion.keys().len());
        for (k, time) in [(0, 0.0), (1, 0.5), (2, 1.0)] {
            assert!(motion.at(time).abs_diff_eq(samples[k].as_affine3a(), 2e-6), "{time}");
        }
        for i in 0..=100 {
            let time = i as f32 / 100.0;
            let true_one = of(0.8 * f64::from(time)).as_affine3a();
            assert!(motion.at(time).abs_diff_eq(true_one, 1e-5), "{time}: {} {true_one}", motion.at(time));
        }
        assert_eq!(Motion::new(&[of(0.3), of(0.3)]), None);
        // Straight on, and too fast to be followed.
        let pushed = Motion::new(&[DAffine3::IDENTITY, DAffine3::from_translation(DVec3::X)]).unwrap();
        assert!(!pushed.turns() && pushed.keys().len() == 2);
        assert_eq!(pushed.at(0.25).translation.x, 0.25);
        let wild: Vec<_> = (0..=64).map(|i| of(0.5 * f64::from(i))).collect();
        assert!(!Motion::new(&wild).unwrap().turns());
        assert!(Motion::new(&wild).unwrap().at(0.5).abs_diff_eq(wild[32].as_affine3a(), 1e-5));
    }

    #[test]
    fn times_lie_between_keys_and_the_ends_on_them() {
        assert_eq!(
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| between(3, t)),
            [(0, 0.0), (0, 0.5), (1, 0.0), (1, 0.5), (1, 1.0)]
        );
        assert_eq!(between(2, 1.0), (0, 1.0));
    }
}
