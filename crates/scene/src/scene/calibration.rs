//! Cameras that were calibrated: principal point, focal lengths and lens distortion in OpenCV's models.
//!
//! Points of the plane at distance 1 are (x, y) = (X/Z, Y/Z) of camera space, x to the right, y down, z along the view. A lens
//! moves them to s(r²) (x, y) and a tangential part; a fisheye does so with the points whose distance from the axis is their
//! angle. The picture shows them at (cx + fl_x x, cy + fl_y y).

use std::ops::{Add, Div, Mul, Sub};

use serde::{Deserialize, Serialize};

/// Intrinsics of a camera, in pixels of a picture of `w` × `h`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// OpenCV's fisheye (equidistant), else its perspective camera.
    pub fisheye: bool,
    /// Width of the picture.
    pub w: f64,
    pub h: f64,
    /// Focal length along the rows, > 0.
    pub fl_x: f64,
    /// Focal length along the columns, > 0.
    pub fl_y: f64,
    /// Principal point from the left side of the picture: OpenCV's, plus 0.5.
    pub cx: f64,
    /// Principal point from the top.
    pub cy: f64,
    /// k1 to k6: polynomial and, from k4 on, divisor of s; of a fisheye k1 to k4, the polynomial.
    pub k: [f64; 6],
    /// p1, p2: tangential distortion; 0 of a fisheye.
    pub p: [f64; 2],
}

/// Distortion of a lens: s = (1 + Σ radial r²ⁱ) / (1 + Σ divisor r²ⁱ), and the tangential coefficients.
#[derive(Debug, Clone, Copy)]
pub struct Distortion<T> {
    one: T,
    radial: [T; 4],
    divisor: [T; 3],
    tangential: [T; 2],
}

/// The inverse of a camera's distortion: undistorted points at the nodes of a grid, from which Newton's method starts.
#[derive(Debug, Clone)]
pub struct Undistortion {
    /// Corners of the grid, distorted points in units of the focal lengths: the picture's, and `MARGIN` around it.
    pub corners: [[f64; 2]; 2],
    /// Row by row, [`NODES`] × [`NODES`].
    pub nodes: Vec<[f32; 2]>,
}

/// Nodes of an [`Undistortion`] along a side.
pub const NODES: usize = 33;
/// Steps of Newton's method from interpolated nodes. Each squares an error of about a thousandth.
pub const STEPS: usize = 3;
/// What pixel filters see around a picture, as a share of its sides.
const MARGIN: f64 = 0.02;
/// Largest error of the inverse, in pixels: measured in the middle of all cells of the grid, where the start is worst.
const TOLERANCE: f64 = 1e-3;
/// Most strides to one point of the grid. A camera's take a few, a fold some sixty.
const MOST_STRIDES: usize = 128;
/// Largest number of intrinsics: those of real cameras are far below.
const LARGEST: f64 = 1e9;

impl<T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T>> Distortion<T> {
    /// The distorted point, and the derivatives: of x by x, of x by y (and of y by x), of y by y.
    #[inline(always)]
    pub fn at(&self, [x, y]: [T; 2]) -> ([T; 2], [T; 3]) {
        let Self { one, radial: [a, b, c, d], divisor: [e, f, g], tangential: [p, q] } = *self;
        let (xx, xy, yy) = (x * x, x * y, y * y);
        let r = xx + yy;
        let above = one + r * (a + r * (b + r * (c + r * d)));
        let below = one + r * (e + r * (f + r * g));
        let by_r_above = a + r * (b + b + r * (c + c + c + r * (d + d + d + d)));
        let by_r_below = e + r * (f + f + r * (g + g + g));
        let s = above / below;
        let slope = (by_r_above - s * by_r_below) / below;
        let slope = slope + slope;
        // Half of the tangential part's derivatives.
        let (px, py, qx, qy) = (p * x, p * y, q * x, q * y);
        let u = x * s + (py * x + py * x) + q * (r + xx + xx);
        let v = y * s + p * (r + yy + yy) + (qx * y + qx * y);
        let mixed = xy * slope + (px + qy) + (px + qy);
        let by_x = s + xx * slope + (py + qx + qx + qx) + (py + qx + qx + qx);
        let by_y = s + yy * slope + (qx + py + py + py) + (qx + py + py + py);
        ([u, v], [by_x, mixed, by_y])
    }

    /// A step of Newton's method to the point whose image is `to`.
    #[inline(always)]
    pub fn step(&self, at: [T; 2], to: [T; 2]) -> [T; 2] {
        let ([u, v], [a, b, c]) = self.at(at);
        let (du, dv) = (u - to[0], v - to[1]);
        let determinant = a * c - b * b;
        [at[0] - (c * du - b * dv) / determinant, at[1] - (a * dv - b * du) / determinant]
    }
}

impl<T: Copy> Distortion<T> {
    /// The same in other numbers.
    pub fn map<U>(&self, of: impl Fn(T) -> U) -> Distortion<U> {
        let Self { one, radial, divisor, tangential } = *self;
        Distortion { one: of(one), radial: radial.map(&of), divisor: divisor.map(&of), tangential: tangential.map(&of) }
    }
}

impl Distortion<f64> {
    /// The point near `start` whose image is `to`; `None` where Newton's method leaves the sheet of the picture that `start` is
    /// on: the determinant of the derivatives is not positive, or an error does not halve.
    fn solve(&self, start: [f64; 2], to: [f64; 2]) -> Option<[f64; 2]> {
        let (mut at, mut last) = (start, f64::INFINITY);
        loop {
            let ([u, v], [a, b, c]) = self.at(at);
            let error = (u - to[0]).hypot(v - to[1]);
            if !(a + c > 0.0 && a * c > b * b) {
                return None;
            }
            if error <= 1e-13 * (1.0 + to[0].hypot(to[1])) {
                return Some(at);
            }
            if error >= 0.5 * last || error.is_nan() {
                return None;
            }
            (at, last) = (self.step(at, to), error);
        }
    }

    /// The point whose image is `to`, followed from the axis outward; the last one before the picture folds, or after
    /// [`MOST_STRIDES`].
    fn inverse(&self, to: [f64; 2], reach: f64) -> Result<[f64; 2], [f64; 2]> {
        let (mut at, mut done, mut stride) = ([0.0; 2], 0.0, 0.125);
        for _ in 0..MOST_STRIDES {
            let next = f64::min(done + stride, 1.0);
            match self.solve(at, to.map(|x| x * next)).filter(|found| found[0].hypot(found[1]) < reach) {
                Some(found) if next == 1.0 => return Ok(found),
                Some(found) => (at, done, stride) = (found, next, 2.0 * stride),
                None if stride < 1e-9 => return Err(at),
                None => stride *= 0.5,
            }
        }
        Err(at)
    }
}

impl Calibration {
    /// The kind of camera, and its vertical field of view without distortion, in degrees.
    pub fn described(&self) -> (&'static str, f64) {
        let half = 0.5 * self.h / self.fl_y;
        if self.fisheye {
            ("fisheye", 2.0 * half.to_degrees())
        } else {
            ("perspective", 2.0 * half.atan().to_degrees())
        }
    }

    /// Is it a perspective camera without distortion?
    pub fn is_linear(&self) -> bool {
        !self.fisheye && self.k == [0.0; 6] && self.p == [0.0; 2]
    }

    /// The camera of the same picture with other pixels.
    pub fn scaled(&self, width: u32, height: u32) -> Self {
        let (x, y) = (f64::from(width) / self.w, f64::from(height) / self.h);
        let Self { fl_x, fl_y, cx, cy, .. } = *self;
        Self { w: width.into(), h: height.into(), fl_x: x * fl_x, fl_y: y * fl_y, cx: x * cx, cy: y * cy, ..*self }
    }

    pub fn distortion(&self) -> Distortion<f64> {
        let [a, b, c, d, e, f] = self.k;
        let (radial, divisor) = if self.fisheye { ([a, b, c, d], [0.0; 3]) } else { ([a, b, c, 0.0], [d, e, f]) };
        Distortion { one: 1.0, radial, divisor, tangential: self.p }
    }

    /// The inverse of the distortion, and what is wrong with it, if anything: it folds the picture, or is too strong to be
    /// inverted to a thousandth of a pixel. Beyond a fold the points are those before it.
    pub fn undistortion(&self) -> (Undistortion, Option<String>) {
        let Self { w, h, fl_x, fl_y, cx, cy, .. } = *self;
        let corner = |share: f64| [(share * w - cx) / fl_x, (share * h - cy) / fl_y];
        let corners = [corner(-MARGIN), corner(1.0 + MARGIN)];
        let lens = self.distortion();
        let (reach, mut fold) = (if self.fisheye { std::f64::consts::PI } else { f64::INFINITY }, f64::INFINITY);
        let mut nodes: Vec<[f64; 2]> = Vec::with_capacity(NODES * NODES);
        let mut next_to = None;
        let image = |x: usize, y: usize| {
            let part = [x, y].map(|n| n as f64 / (NODES - 1) as f64);
            [0, 1].map(|axis| corners[0][axis] + part[axis] * (corners[1][axis] - corners[0][axis]))
        };
        for i in 0..NODES * NODES {
            let to = image(i % NODES, i / NODES);
            let near = next_to.filter(|_| i % NODES > 0).and_then(|start| lens.solve(start, to));
            let found = near.filter(|near| near[0].hypot(near[1]) < reach).map_or_else(|| lens.inverse(to, reach), Ok);
            next_to = found.ok();
            fold = found.err().map_or(fold, |last| fold.min(last[0].hypot(last[1])));
            nodes.push(found.unwrap_or_else(|last| last));
        }
        let fault = fold.is_finite().then(|| {
            let angle = if self.fisheye { fold } else { fold.atan() }.to_degrees();
            format!(
                "its distortion folds the picture at {angle:.1} degrees from the view axis, inside the frame or right beside \
                 it: use the coefficients of a calibration that reaches the corners, or the camera of a crop"
            )
        });
        let error = |i: usize| {
            let (x, y) = (i % (NODES - 1), i / (NODES - 1));
            let [a, b] = [image(x, y), image(x + 1, y + 1)];
            let to = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
            let around = [0, 1, NODES, NODES + 1].map(|offset| nodes[y * NODES + x + offset]);
            let start = [0, 1].map(|axis| around.iter().map(|node| 0.25 * node[axis]).sum());
            let ([u, v], _) = lens.at((0..STEPS).fold(start, |at, _| lens.step(at, to)));
            (fl_x * (u - to[0])).hypot(fl_y * (v - to[1]))
        };
        let inexact = !(0..(NODES - 1).pow(2)).map(error).all(|error| error <= TOLERANCE);
        let inexact = inexact.then(|| format!("its distortion cannot be inverted to {TOLERANCE} pixels"));
        let nodes = nodes.into_iter().map(|node| node.map(|x| x as f32)).collect();
        (Undistortion { corners, nodes }, fault.or(inexact))
    }

    /// What is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        let Self { w, h, fl_x, fl_y, cx, cy, k, p, .. } = *self;
        let mut all = [w, h, fl_x, fl_y, cx, cy].into_iter().chain(k).chain(p);
        if !all.all(|x| x.abs() < LARGEST) || fl_x.min(fl_y) < 1e-9 {
            return Some("its intrinsics are not finite, or a focal length is not above 0".into());
        }
        if ![w, h].iter().all(|size| (1.0..=f64::from(u16::MAX)).contains(size)) {
            return Some(format!("its size is {w} x {h} pixels"));
        }
        if self.is_linear() { None } else { self.undistortion().1 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(fisheye: bool, focal: f64, k: [f64; 6]) -> Calibration {
        Calibration { fisheye, w: 800.0, h: 600.0, fl_x: focal, fl_y: focal, cx: 400.0, cy: 300.0, k, p: [0.0; 2] }
    }

    #[test]
    fn distortion_that_folds_is_refused_with_the_angle_and_other_is_not() {
        let k = |k1: f64| [k1, 0.0, 0.0, 0.0, 0.0, 0.0];
        // r - 0.3 r³ is largest at r = 1.054, which is 46.5 degrees, and 0.703 there: the corner at 500 pixels is beyond.
        assert!(of(false, 600.0, k(-0.3)).fault().unwrap().contains("46.5 degrees"));
        assert_eq!(of(false, 750.0, k(-0.3)).fault(), None);
        assert!(of(true, 350.0, k(-0.1)).fault().unwrap().contains("104.6 degrees"));
        assert!(of(true, 150.0, k(0.0)).fault().unwrap().contains("180.0 degrees"));
        assert_eq!(of(true, 170.0, k(0.0)).fault(), None);
        // Up to a pole of the divisor everything has its place.
        assert_eq!(of(false, 300.0, [0.0, 0.0, 0.0, -0.5, 0.0, 0.0]).fault(), None);
        for bad in [f64::NAN, f64::INFINITY, 1e30] {
            assert!(of(false, 600.0, k(bad)).fault().unwrap().contains("not finite"));
            assert!(Calibration { cx: bad, ..of(false, 600.0, k(0.0)) }.fault().is_some());
        }
        assert!(of(false, 0.0, k(0.0)).fault().is_some() && of(false, -5.0, k(0.0)).fault().is_some());
    }

    #[test]
    fn cameras_without_an_inverse_are_refused_at_once() {
        let wild = [1e8, -1e8, 1e8, -1e8, 1e8, -1e8];
        let mut cameras = vec![
            Calibration { p: [1e6, -1e6], ..of(false, 600.0, [0.0; 6]) },
            Calibration { p: [1e8, 1e8], ..of(false, 600.0, wild) },
            Calibration { p: [-1e-3, 1e8], ..of(false, 1e-8, wild.map(|k| 1e-6 * k)) },
            Calibration { cx: 1e8, ..of(true, 600.0, wild) },
        ];
        // Coefficients of all sizes and signs.
        for i in 0..60_u32 {
            let of_number = |n: u32| {
                let bits = i.wrapping_mul(2_654_435_761).wrapping_add(n.wrapping_mul(0x9e37_79b9)) >> 8;
                let sign = if bits & 1 == 0 { 1.0 } else { -1.0 };
                sign * 10.0_f64.powf(f64::from(bits % 1_100) / 100.0 - 3.0)
            };
            let lens = of(i % 3 == 0, of_number(9).abs(), [0, 1, 2, 3, 4, 5].map(of_number));
            cameras.push(Calibration { p: if i % 3 == 0 { [0.0; 2] } else { [6, 7].map(of_number) }, ..lens });
        }
        for (i, camera) in cameras.iter().enumerate() {
            let seconds = |_| {
                let began = std::time::Instant::now();
                assert!(camera.fault().is_some() || i >= 4, "{camera:?}");
                began.elapsed().as_secs_f64()
            };
            // Other programs run beside the test.
            let least = (0..5).map(seconds).fold(f64::INFINITY, f64::min);
            assert!(least < 0.25, "{least} s: {camera:?}");
        }
    }

    #[test]
    fn derivatives_are_those_of_the_distortion() {
        let lens =
            Calibration { p: [0.02, -0.03], ..of(false, 600.0, [-0.2, 0.05, 0.01, 0.1, -0.02, 0.003]) }.distortion();
        for [x, y] in [[0.3, -0.2], [-0.7, 0.4], [0.0, 0.9]] {
            let (_, [by_x, mixed, by_y]) = lens.at([x, y]);
            let slope = |a: [f64; 2], b: [f64; 2]| {
                let ([u, v], [s, t]) = (lens.at(a).0, lens.at(b).0);
                [(u - s) / 2e-6, (v - t) / 2e-6]
            };
            let (across, down) = (slope([x + 1e-6, y], [x - 1e-6, y]), slope([x, y + 1e-6], [x, y - 1e-6]));
            for (found, expected) in [(by_x, across[0]), (mixed, across[1]), (mixed, down[0]), (by_y, down[1])] {
                assert!((found - expected).abs() < 1e-8, "{found} {expected}");
            }
        }
    }
}
