//! Motion while the shutter is open: keys evenly spaced in time, from 0 (shutter opens) to 1 (shutter closes).

use glam::{Affine3A, DAffine3, DMat3, DQuat, DVec3, Mat3, Quat, Vec3};

/// Largest number of intervals between keys; Embree's limit.
pub const MAX_STEPS: usize = 128;

/// Largest rotation between two keys, in radians (3.5°). Up to 3.6° Embree interpolates quaternions linearly and
/// normalizes them, which is reproduced here bit for bit; beyond, its slerp is off by 1e-5, enough for rays to start below
/// the surface.
const MAX_ROTATION_PER_STEP: f64 = 0.061;

/// Largest deviation from a line, relative to the largest number, that is a rounding error of single precision.
const ROUNDING_ERROR: f64 = 2.0 / (1 << 23) as f64;

/// Index of the key before `time` (in [0, 1]) among `keys` keys (≥ 2), and the weight of the next key in [0, 1]; the
/// arithmetic is Embree's.
#[inline]
pub fn key_before(keys: usize, time: f32) -> (usize, f32) {
    let scaled = time * (keys - 1) as f32;
    let before = (scaled as usize).min(keys - 2);
    (before, scaled - before as f32)
}

/// Linear interpolation from `a` (weight 0) to `b` (weight 1).
#[inline]
pub fn mix(a: Vec3, b: Vec3, weight: f32) -> Vec3 {
    a * (1.0 - weight) + b * weight
}

/// A transform that changes over time.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    keys: Vec<Key>,
    has_rotation: bool,
}

/// A transform: `linear`, then `rotation`, then `translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Key {
    /// Identity if the motion has no rotation.
    pub rotation: Quat,
    /// Upper triangular (scale and shear) if the motion has rotation; else the whole matrix.
    pub linear: Mat3,
    /// Metres.
    pub translation: Vec3,
}

impl Motion {
    /// Interpolates invertible transforms that are evenly spaced in time; `None` if there are none or all are equal. Of
    /// transforms on a line only the first and the last become keys.
    pub fn new(samples: &[DAffine3]) -> Option<Self> {
        let ends = [*samples.first()?, *samples.last()?];
        // Other nodes may need all samples; Embree's build takes time and memory for each key.
        let samples = if are_on_line(samples, &ends) { &ends } else { samples };
        let first = ends[0].as_affine3a();
        if samples.iter().all(|m| m.as_affine3a() == first) {
            return None;
        }
        let without_rotation = |m: &DAffine3| Key {
            rotation: Quat::IDENTITY,
            linear: m.matrix3.as_mat3(),
            translation: m.translation.as_vec3(),
        };
        let factored: Vec<_> = samples.iter().map(|m| (factor_rotation(m.matrix3), m.translation)).collect();
        let angle = |pair: &[((DQuat, DMat3), DVec3)]| pair[0].0.0.angle_between(pair[1].0.0);
        let largest = factored.windows(2).map(angle).fold(0.0, f64::max);
        let parts = (largest / MAX_ROTATION_PER_STEP).ceil().max(1.0) as usize;
        if largest < 1e-9 || parts * (samples.len() - 1) > MAX_STEPS {
            // At such a speed, the difference between an arc and its chords is not visible.
            return Some(Self { keys: samples.iter().map(without_rotation).collect(), has_rotation: false });
        }
        let mut keys: Vec<Key> = Vec::with_capacity(parts * (samples.len() - 1) + 1);
        let mut add = |rotation: DQuat, linear: DMat3, translation: DVec3| {
            let rotation = rotation.as_quat();
            // Of the two quaternions of this rotation, the one closer to the previous key.
            let is_near = keys.last().is_none_or(|last| last.rotation.dot(rotation) >= 0.0);
            let rotation = if is_near { rotation } else { -rotation };
            keys.push(Key { rotation, linear: linear.as_mat3(), translation: translation.as_vec3() });
        };
        for pair in factored.windows(2) {
            let [((q0, l0), t0), ((q1, l1), t1)] = [pair[0], pair[1]];
            for part in 0..parts {
                let u = part as f64 / parts as f64;
                add(q0.slerp(q1, u), l0 * (1.0 - u) + l1 * u, t0.lerp(t1, u));
            }
        }
        if let Some(((rotation, linear), translation)) = factored.last() {
            add(*rotation, *linear, *translation);
        }
        Some(Self { keys, has_rotation: true })
    }

    /// The keys; at least two.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Are rotations interpolated as quaternions? Otherwise matrices are interpolated linearly.
    pub fn has_rotation(&self) -> bool {
        self.has_rotation
    }

    /// The transform at a time in [0, 1] of the shutter.
    #[inline]
    pub fn at(&self, time: f32) -> Affine3A {
        let (before, weight) = key_before(self.keys.len(), time);
        let (a, b) = (&self.keys[before], &self.keys[before + 1]);
        let linear = a.linear * (1.0 - weight) + b.linear * weight;
        let matrix = match self.has_rotation {
            false => linear,
            true => Mat3::from_quat((a.rotation * (1.0 - weight) + b.rotation * weight).normalize()) * linear,
        };
        Affine3A::from_mat3_translation(matrix, mix(a.translation, b.translation, weight))
    }
}

impl Key {
    pub fn transform(&self) -> Affine3A {
        Affine3A::from_mat3_translation(Mat3::from_quat(self.rotation) * self.linear, self.translation)
    }
}

/// Do samples that are evenly spaced lie on the line between the ends, to rounding?
fn are_on_line(samples: &[DAffine3], [first, last]: &[DAffine3; 2]) -> bool {
    let largest = |numbers: &[f64]| numbers.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    let size = [first, last].map(|m| [largest(&m.matrix3.to_cols_array()), largest(&m.translation.to_array())]);
    let size = [0, 1].map(|group| size[0][group].max(size[1][group]));
    samples.iter().enumerate().all(|(i, sample)| {
        let weight = i as f64 / (samples.len() - 1) as f64;
        let linear = first.matrix3 * (1.0 - weight) + last.matrix3 * weight - sample.matrix3;
        let translation = first.translation.lerp(last.translation, weight) - sample.translation;
        largest(&linear.to_cols_array()) <= ROUNDING_ERROR * size[0]
            && largest(&translation.to_array()) <= ROUNDING_ERROR * size[1]
    })
}

/// Factors a matrix into a rotation and an upper triangular matrix, applied in reverse order (Gram–Schmidt).
fn factor_rotation(m: DMat3) -> (DQuat, DMat3) {
    let x = m.x_axis.normalize();
    let y = (m.y_axis - x * x.dot(m.y_axis)).normalize();
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    let mut upper = rotation.transpose() * m;
    (upper.x_axis.y, upper.x_axis.z, upper.y_axis.z) = (0.0, 0.0, 0.0);
    (DQuat::from_mat3(&rotation), upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_are_met_at_their_time_samples_and_rotate_on_arcs_between() {
        let of = |angle: f64| {
            DAffine3::from_scale_rotation_translation(
                DVec3::new(2.0, -3.0, 0.5),
                DQuat::from_rotation_z(angle),
                DVec3::new(1.0 + angle, 0.0, 0.0),
            )
        };
        let of_line = |time: f64| {
            let moved = DVec3::new(1.0, 2.0, 3.0) + time * DVec3::new(0.3, -0.7, 0.1);
            // As in files.
            let moved = moved.as_vec3().as_dvec3();
            DAffine3::from_scale_rotation_translation(DVec3::splat(1.0 + time), DQuat::from_rotation_y(0.4), moved)
        };
        let samples = [of(0.0), of(0.4), of(0.8)];
        let motion = Motion::new(&samples).unwrap();
        assert!(motion.has_rotation() && motion.keys().len() == 15, "{}", motion.keys().len());
        for (k, time) in [(0, 0.0), (1, 0.5), (2, 1.0)] {
            assert!(motion.at(time).abs_diff_eq(samples[k].as_affine3a(), 2e-6), "{time}");
        }
        for i in 0..=100 {
            let time = i as f32 / 100.0;
            let true_one = of(0.8 * f64::from(time)).as_affine3a();
            assert!(motion.at(time).abs_diff_eq(true_one, 1e-5), "{time}: {} {true_one}", motion.at(time));
        }
        assert_eq!(Motion::new(&[of(0.3), of(0.3)]), None);
        // On a line in any number of steps, beside the line, and too fast to be followed.
        for steps in [1, 2, 128] {
            let at = |step: u32| of_line(f64::from(step) / f64::from(steps));
            let pushed = Motion::new(&(0..=steps).map(at).collect::<Vec<_>>()).unwrap();
            assert_eq!(pushed.keys().len(), 2, "{steps}");
            assert!(pushed.at(0.3).abs_diff_eq(of_line(f64::from(0.3_f32)).as_affine3a(), 2e-6));
        }
        let beside = Motion::new(&[of_line(0.0), of_line(0.501), of_line(1.0)]).unwrap();
        assert_eq!(beside.keys().len(), 3);
        let pushed = Motion::new(&[DAffine3::IDENTITY, DAffine3::from_translation(DVec3::X)]).unwrap();
        assert!(!pushed.has_rotation() && pushed.keys().len() == 2);
        assert_eq!(pushed.at(0.25).translation.x, 0.25);
        let wild: Vec<_> = (0..=64).map(|i| of(0.5 * f64::from(i))).collect();
        assert!(!Motion::new(&wild).unwrap().has_rotation());
        assert!(Motion::new(&wild).unwrap().at(0.5).abs_diff_eq(wild[32].as_affine3a(), 1e-5));
    }

    #[test]
    fn times_lie_between_keys_and_the_ends_on_them() {
        assert_eq!(
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|t| key_before(3, t)),
            [(0, 0.0), (0, 0.5), (1, 0.0), (1, 0.5), (1, 1.0)]
        );
        assert_eq!(key_before(2, 1.0), (0, 1.0));
    }
}
