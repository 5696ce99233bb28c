//! Pictures that were read from files.

use glam::{Mat3, Vec3};

/// A picture that was read.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The data window in pixels: x0, y0, x1, y1 with x1 and y1 exclusive.
    pub window: [i64; 4],
    /// The display window in pixels, in the same form: the whole picture, of which `window` has pixels.
    pub display: [i64; 4],
    /// Linear RGB, row-major over `window`.
    pub rgb: Vec<[f32; 3]>,
    /// Variance of each value of `rgb` from the layer `variance`, if the file has one.
    pub variance: Option<Vec<[f32; 3]>>,
    /// Coverage of each pixel from the channel A, if the file has one. `rgb` is premultiplied by it.
    pub alpha: Option<Vec<f32>>,
    /// Whether the values are display-referred, at most 1, as in a PNG.
    pub displayed: bool,
    /// Variance of the picture's mean over the sum of `variance`, of R, G and B: less where paths are stratified, more where pixels
    /// share them. 1 where it is not known.
    pub mean_variance: [f64; 3],
}

impl Picture {
    /// The part of the picture in a window that lies in its own.
    pub fn within(&self, window: [i64; 4]) -> Self {
        let [x0, y0, x1, y1] = window;
        let [width, _] = self.size();
        let indices: Vec<usize> = (y0..y1)
            .flat_map(|y| (x0..x1).map(move |x| (x, y)))
            .map(|(x, y)| (y - self.window[1]) as usize * width + (x - self.window[0]) as usize)
            .collect();
        let colors = |all: &[[f32; 3]]| indices.iter().map(|i| all[*i]).collect();
        Self {
            window,
            display: self.display,
            rgb: colors(&self.rgb),
            variance: self.variance.as_deref().map(colors),
            alpha: self.alpha.as_ref().map(|all| indices.iter().map(|i| all[*i]).collect()),
            displayed: self.displayed,
            mean_variance: self.mean_variance,
        }
    }

    /// The colours of the display window, row-major; black where the data window has none.
    pub fn shown(&self) -> Vec<[f32; 3]> {
        let [x0, y0, x1, y1] = self.display;
        let pixel = |x: i64, y: i64| {
            let inside = (self.window[0]..self.window[2]).contains(&x) && (self.window[1]..self.window[3]).contains(&y);
            let index = |x: i64, y: i64| (y - self.window[1]) as usize * self.size()[0] + (x - self.window[0]) as usize;
            if inside { self.rgb[index(x, y)] } else { [0.0; 3] }
        };
        (y0..y1).flat_map(|y| (x0..x1).map(move |x| pixel(x, y))).collect()
    }

    /// Changes the colours by a matrix, and their variances as those of uncorrelated values. Colours that are not finite stay:
    /// an infinite sun would become NaN.
    pub fn transform(&mut self, matrix: Mat3) {
        let finite = self.rgb.iter_mut().filter(|c| c.iter().all(|x| x.is_finite()));
        finite.for_each(|c| *c = (matrix * Vec3::from(*c)).into());
        let squared = Mat3::from_cols(matrix.x_axis.powf(2.0), matrix.y_axis.powf(2.0), matrix.z_axis.powf(2.0));
        self.variance.iter_mut().flatten().for_each(|v| *v = (squared * Vec3::from(*v)).into());
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        let [x0, y0, x1, y1] = self.window;
        [(x1 - x0) as usize, (y1 - y0) as usize]
    }

    /// Width in pixels, and linear RGB row by row.
    pub fn colors(&self) -> (usize, impl Iterator<Item = [f32; 3]>) {
        (self.size()[0], self.rgb.iter().copied())
    }
}
