//! Discrete integrands with exactly known means and variances, and small images of them.

use bismar::balance::PixelFeatures;
use bismar::balance::{Counts, Heuristic};
use glam::Vec3;

/// One atom of a discrete domain.
#[derive(Debug, Clone, Copy)]
pub struct Atom {
    /// Mass of the integrand, by colour channel.
    pub f: [f64; 3],
    /// Probability of this atom under light sampling.
    pub light: f64,
    /// Probability of this atom under BSDF sampling.
    pub bsdf: f64,
}

impl Atom {
    /// r = (p_l − p_b)/(p_l + p_b).
    pub fn r(&self) -> f64 {
        (self.light - self.bsdf) / (self.light + self.bsdf)
    }

    /// The mass that a picture counts. Like the integrator, it drops values that are not finite or have no positive channel.
    fn counted(&self) -> [f64; 3] {
        if self.f.iter().all(|x| x.is_finite()) && self.f.iter().any(|&x| x > 0.0) { self.f } else { [0.0; 3] }
    }

    /// MIS-weighted contribution of a light or BSDF sample of this atom to the sum over paths, with the counts of `counts`.
    pub fn contribution(&self, heuristic: Heuristic, counts: Counts, by_light: bool) -> [f64; 3] {
        let (l, b) = (f64::from(counts.light_per_path()) * self.light, f64::from(counts.bsdf_per_path()) * self.bsdf);
        let (own, other) = if by_light { (l, b) } else { (b, l) };
        let weight = f64::from(heuristic.weight(own as f32, other as f32));
        self.counted().map(|f| f * weight / own)
    }
}

#[derive(Debug, Clone)]
pub struct Domain {
    /// Atoms. Each technique's probabilities add up to one.
    pub atoms: Vec<Atom>,
}

impl Domain {
    /// From atoms (f, p_l, p_b). A dark atom completes the probabilities to one.
    pub fn new(places: impl IntoIterator<Item = ([f64; 3], f64, f64)>) -> Self {
        let mut atoms: Vec<_> = places.into_iter().map(|(f, light, bsdf)| Atom { f, light, bsdf }).collect();
        let rest = |of: fn(&Atom) -> f64| (1.0 - atoms.iter().map(of).sum::<f64>()).max(0.0);
        let (light, bsdf) = (rest(|a| a.light), rest(|a| a.bsdf));
        if light + bsdf > 1e-12 {
            atoms.push(Atom { f: [0.0; 3], light, bsdf });
        }
        Self { atoms }
    }

    /// From atoms whose f is equal in all channels.
    pub fn grey(places: impl IntoIterator<Item = (f64, f64, f64)>) -> Self {
        Self::new(places.into_iter().map(|(f, l, b)| ([f; 3], l, b)))
    }

    /// Scales the integrand by a factor.
    pub fn times(mut self, factor: f64) -> Self {
        self.atoms.iter_mut().for_each(|a| a.f = a.f.map(|f| f * factor));
        self
    }

    /// The integral, by channel.
    pub fn total(&self) -> [f64; 3] {
        std::array::from_fn(|c| self.atoms.iter().map(|a| a.counted()[c]).sum())
    }

    /// Samples an atom by a technique, from `u` in [0, 1).
    pub fn sample(&self, by_light: bool, mut u: f64) -> &Atom {
        let p = |a: &Atom| if by_light { a.light } else { a.bsdf };
        for atom in &self.atoms {
            if u < p(atom) {
                return atom;
            }
            u -= p(atom);
        }
        // Rounding: the last atom that this technique reaches.
        self.atoms.iter().rev().find(|a| p(a) > 0.0).unwrap_or(&self.atoms[0])
    }

    /// Exact variance of a pass's mean over paths with these counts: `Σ_i n_i Var_i[contribution] / N²`.
    pub fn variance(&self, heuristic: Heuristic, counts: Counts) -> [f64; 3] {
        let mut variance = [0.0; 3];
        for (by_light, n) in [(true, counts.light), (false, counts.bsdf)] {
            let (mut mean, mut squares) = ([0.0; 3], [0.0; 3]);
            for atom in &self.atoms {
                let p = if by_light { atom.light } else { atom.bsdf };
                if p > 0.0 {
                    let contribution = atom.contribution(heuristic, counts, by_light);
                    for c in 0..3 {
                        mean[c] += p * contribution[c];
                        squares[c] += p * contribution[c] * contribution[c];
                    }
                }
            }
            for c in 0..3 {
                variance[c] += f64::from(n) * (squares[c] - mean[c] * mean[c]).max(0.0);
            }
        }
        variance.map(|v| v / f64::from(counts.paths).powi(2))
    }

    /// The least variance of any counts of `paths` paths over that of equal counts, channels added up; 1 where equal counts
    /// have none.
    pub fn best(&self, paths: u32) -> f64 {
        let at = |counts| self.variance(Heuristic::Balance, counts).iter().sum::<f64>();
        let half = at(Counts::half(paths));
        let least = (1..2 * paths).map(|light| at(Counts { light, bsdf: 2 * paths - light, ..Counts::half(paths) }));
        if half > 0.0 { least.fold(f64::INFINITY, f64::min) / half } else { 1.0 }
    }
}

#[derive(Debug, Clone)]
pub struct Image {
    pub width: usize,
    pub pixels: Vec<Domain>,
    /// Guides of the spread over neighbouring pixels, one per pixel.
    pub guides: Vec<PixelFeatures>,
}

/// Pixels along a side of the images.
pub const SIDE: usize = 4;

impl Image {
    /// From the domain and the material index of each pixel (x, y).
    pub fn new(of: impl Fn(usize, usize) -> (Domain, u32)) -> Self {
        let places = (0..SIDE * SIDE).map(|i| of(i % SIDE, i / SIDE));
        let guide = |material| PixelFeatures { object: 1, material, normal: Vec3::Y, depth: 1.0, roughness: 0.5 };
        let (pixels, guides) = places.map(|(domain, material)| (domain, guide(material))).unzip();
        Self { width: SIDE, pixels, guides }
    }

    /// An image whose pixels are all equal.
    pub fn flat(domain: &Domain) -> Self {
        Self::new(|_, _| (domain.clone(), 1))
    }
}
