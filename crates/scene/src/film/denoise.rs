//! Intel's Open Image Denoise, loaded at run time: it is needed neither to build nor to render.

use std::ffi::{CStr, c_char, c_int, c_void};
use std::path::{Path, PathBuf};
use std::ptr;
use std::sync::{Mutex, PoisonError};

use libloading::Library;

use super::aov::Aov;
use super::pixels::{Background, Pixels, positions};
use super::stats::accumulate;
use crate::{Error, Result};

/// The environment variable with the path of the library.
const VARIABLE: &str = "BISMAR_OIDN";
/// Where the Python package pyoidn has the library, below its own folder.
const IN_PACKAGE: &str = "oidn/lib/libOpenImageDenoise.so.2";
/// The library in a folder of that package which a caller has named.
static NAMED: Mutex<Option<PathBuf>> = Mutex::new(None);
/// File names of the library on common systems, newest first.
const NAMES: [&str; 3] = ["libOpenImageDenoise.so.2", "libOpenImageDenoise.so.1", "libOpenImageDenoise.so"];

/// Layer of the denoised beauty.
pub const DENOISED: &str = "denoised";

#[derive(Debug)]
pub struct Denoiser {
    library: Library,
}

/// A device or filter of the library.
type Handle = *mut c_void;
type SetImage = unsafe extern "C" fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
type SetBool = unsafe extern "C" fn(Handle, *const c_char, bool);
type GetError = unsafe extern "C" fn(Handle, *mut *const c_char) -> c_int;
type Action = unsafe extern "C" fn(Handle);

/// Names the folder of the package pyoidn: [`Denoiser::load`] also looks into it.
pub fn look_into(package: &Path) {
    *NAMED.lock().unwrap_or_else(PoisonError::into_inner) = Some(package.join(IN_PACKAGE));
}

/// The libraries of the package pyoidn of all Pythons that the environment names: by a virtual environment or `PATH`, of the
/// user's own, and those of pyenv, whose folder in `PATH` has no library beside it.
fn of_packages() -> Vec<PathBuf> {
    let variable = |name| std::env::var_os(name).map(PathBuf::from);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut roots: Vec<PathBuf> = ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().filter_map(variable).collect();
    let beside = |folder: PathBuf| folder.parent().map(Path::to_owned).filter(|_| folder.is_absolute());
    roots.extend(std::env::split_paths(&path).filter_map(beside));
    roots.extend(variable("HOME").map(|home| home.join(".local")));
    let below = |folder: PathBuf| {
        let mut found: Vec<_> = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
        found.sort_by(|a, b| b.cmp(a));
        found
    };
    let versions: Vec<PathBuf> = roots.iter().flat_map(|root| below(root.join("versions"))).collect();
    let pythons = roots.into_iter().chain(versions).flat_map(|root| below(root.join("lib")));
    let is_python =
        |folder: &PathBuf| folder.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"python3"));
    let packages =
        pythons.filter(is_python).flat_map(|python| ["site-packages", "dist-packages"].map(|of| python.join(of)));
    let own = NAMED.lock().unwrap_or_else(PoisonError::into_inner).clone();
    let libraries = own.into_iter().chain(packages.map(|packages| packages.join("pyoidn").join(IN_PACKAGE)));
    libraries.filter(|library| library.is_file()).collect()
}

impl Denoiser {
    /// Loads the library: of the system, else of the Python package pyoidn.
    ///
    /// # Errors
    /// [`Error::Host`] with how to install it.
    pub fn load() -> Result<Self> {
        let names = match std::env::var_os(VARIABLE) {
            Some(name) => vec![name],
            None => NAMES.iter().map(Into::into).chain(of_packages().into_iter().map(Into::into)).collect(),
        };
        let mut why = String::new();
        for name in &names {
            // SAFETY: loading runs the library's initialisers: Open Image Denoise's set up its own state alone. The file is
            // found as any shared library of the system is, or where the user's own environment says.
            match unsafe { Library::new(name) } {
                Ok(library) => return Ok(Self { library }),
                Err(e) if why.is_empty() => why = e.to_string(),
                Err(_) => {}
            }
        }
        Err(Error::Host(format!(
            "Open Image Denoise is not installed ({why}): `pip install pyoidn`, in an active virtual environment, \
             brings it; or unpack a release from https://github.com/RenderKit/oidn/releases and set {VARIABLE} to its \
             lib/libOpenImageDenoise.so.2"
        )))
    }

    fn function<T: Copy>(&self, name: &CStr) -> Result<T> {
        // SAFETY: callers ask for functions of oidn.h with the types that it declares, unchanged since version 1.0 (image
        // and device functions) and 2.0 (`oidnSetFilterBool`, of the same type as its forerunner).
        let found = unsafe { self.library.get::<T>(name.to_bytes_with_nul()) };
        found.map(|f| *f).map_err(|e| Error::Host(format!("this Open Image Denoise is too old: {e}")))
    }

    /// Denoises a picture in this process; the result is linear RGB, row by row.
    ///
    /// # Errors
    /// [`Error::Host`] with the message of the library.
    pub fn denoise(&self, noisy: &NoisyPicture) -> Result<Vec<[f32; 3]>> {
        const CPU: c_int = 1;
        const FLOAT3: c_int = 3;
        let n = noisy.images[0].len();
        let height = n / noisy.width.max(1);
        assert!(noisy.images.iter().all(|image| image.len() == n) && noisy.width * height == n);
        let new_device: unsafe extern "C" fn(c_int) -> Handle = self.function(c"oidnNewDevice")?;
        let new_filter: unsafe extern "C" fn(Handle, *const c_char) -> Handle = self.function(c"oidnNewFilter")?;
        let set_image: SetImage = self.function(c"oidnSetSharedFilterImage")?;
        let set_bool: SetBool = self.function(c"oidnSetFilterBool").or_else(|_| self.function(c"oidnSetFilter1b"))?;
        let get_error: GetError = self.function(c"oidnGetDeviceError")?;
        let [commit_device, commit, execute, release_filter, release_device]: [Action; 5] = [
            self.function(c"oidnCommitDevice")?,
            self.function(c"oidnCommitFilter")?,
            self.function(c"oidnExecuteFilter")?,
            self.function(c"oidnReleaseFilter")?,
            self.function(c"oidnReleaseDevice")?,
        ];
        let clean = |p: &[f32; 3]| p.map(|x| if x.is_finite() { x } else { 0.0 });
        let [mut color, mut albedo, mut normal] =
            noisy.images.each_ref().map(|image| image.iter().map(clean).collect::<Vec<_>>());
        let mut output = vec![[0.0_f32; 3]; n];
        // SAFETY: the functions have oidn.h's types (see `function`). The four images have width * height pixels of three
        // floats, as they are declared, and outlive the filter, which is executed on this thread and released before they are.
        // Handles are used only where they are not null; the error's text is copied before its device goes.
        let error = unsafe {
            let device = new_device(CPU);
            if device.is_null() {
                return Err(Error::Host("Open Image Denoise has no device".into()));
            }
            commit_device(device);
            let filter = new_filter(device, c"RT".as_ptr());
            if !filter.is_null() {
                let images: [(&CStr, &mut Vec<[f32; 3]>); 4] = [
                    (c"color", &mut color),
                    (c"albedo", &mut albedo),
                    (c"normal", &mut normal),
                    (c"output", &mut output),
                ];
                for (name, pixels) in images {
                    let (data, width) = (pixels.as_mut_ptr().cast(), noisy.width);
                    set_image(filter, name.as_ptr(), data, FLOAT3, width, height, 0, 0, 0);
                }
                set_bool(filter, c"hdr".as_ptr(), true);
                commit(filter);
                execute(filter);
            }
            let mut text = ptr::null();
            let code = get_error(device, &mut text);
            let error = match (code, text.is_null()) {
                (0, _) => None,
                (_, true) => Some(format!("error {code}")),
                (_, false) => Some(CStr::from_ptr(text).to_string_lossy().into_owned()),
            };
            if !filter.is_null() {
                release_filter(filter);
            }
            release_device(device);
            error
        };
        error.map_or(Ok(output), |why| Err(Error::Host(format!("Open Image Denoise: {why}"))))
    }
}

/// Pictures for the denoiser: the beauty and its guides.
#[derive(Debug, Default)]
pub struct NoisyPicture {
    pub width: usize,
    /// Row by row: radiance (linear RGB); base colour in [0, 1] and world-space normals, also of surfaces that are seen
    /// in mirrors.
    pub images: [Vec<[f32; 3]>; 3],
}

impl NoisyPicture {
    /// The beauty and guides of `pixels`, which must have extra sums.
    pub fn of(pixels: &dyn Pixels) -> Self {
        let [x0, _, x1, _] = pixels.window();
        let [mut color, mut albedo, mut normal] = [Vec::new(), Vec::new(), Vec::new()];
        for (x, y) in positions(pixels) {
            let (stats, extras) = (pixels.at(x, y).0, pixels.extras(x, y).unwrap_or_default());
            let n = stats.samples.max(1) as f32;
            color.push(stats.mean());
            albedo.push(extras.guide_albedo.map(|sum| (sum / n).clamp(0.0, 1.0)));
            normal.push(extras.guide_normal.map(|sum| sum / n));
        }
        Self { width: (x1 - x0) as usize, images: [color, albedo, normal] }
    }
}

/// The colours of surfaces, from those of pixels that they cover in part. Pixels without coverage have the mean of the nearest ones, so
/// that the denoiser sees no edge that alpha has already. Row by row, as `image` and `coverage`.
fn of_surfaces(image: &[[f32; 3]], coverage: &[f32], width: usize) -> Vec<[f32; 3]> {
    let (half_width, height) = (width.div_ceil(2), image.len() / width.max(1));
    let half = |i: usize| i / width / 2 * half_width + i % width / 2;
    let around = if coverage.iter().all(|share| *share > 0.0) || image.len() == 1 {
        Vec::new()
    } else {
        let n = half_width * height.div_ceil(2);
        let (mut colors, mut shares) = (vec![[0.0; 3]; n], vec![0.0; n]);
        for (i, (color, share)) in image.iter().zip(coverage).enumerate() {
            accumulate(&mut colors[half(i)], *color);
            shares[half(i)] += share;
        }
        of_surfaces(&colors, &shares, half_width)
    };
    let color = |(i, (color, share)): (usize, (&[f32; 3], &f32))| match *share > 0.0 {
        true => color.map(|c| c / share),
        false => around.get(half(i)).copied().unwrap_or_default(),
    };
    image.iter().zip(coverage).enumerate().map(color).collect()
}

/// The denoised beauty, `denoised`, and layers of lights, `denoised_NAME`, which add up to it: their names and colours, linear RGB
/// row by row. All are guided by albedo and normals. `pixels` must have extra sums. `denoise` is called for one after the other.
///
/// What the layers lack of the denoised beauty is shared among them in proportion: no layer gets light that it has not, and the
/// beauty is that of a picture without layers.
///
/// Where A is coverage, the colours of the surfaces are denoised and multiplied by it, so that they end where alpha does: the picture
/// is premultiplied as the noisy one is.
///
/// # Errors
/// Those of `denoise`.
pub fn denoised_layers(
    pixels: &dyn Pixels,
    mut denoise: impl FnMut(&NoisyPicture) -> Result<Vec<[f32; 3]>>,
) -> Result<Vec<(String, Vec<[f32; 3]>)>> {
    let mut picture = NoisyPicture::of(pixels);
    let coverage: Option<Vec<_>> = (pixels.background() == Background::Transparent)
        .then(|| positions(pixels).map(|(x, y)| pixels.at(x, y).0.coverage()).collect());
    if let Some(coverage) = &coverage {
        picture.images[1..].iter_mut().for_each(|guide| *guide = of_surfaces(guide, coverage, picture.width));
    }
    let mut denoise = |picture: &mut NoisyPicture| -> Result<Vec<[f32; 3]>> {
        let Some(coverage) = &coverage else { return denoise(picture) };
        let surfaces = of_surfaces(&picture.images[0], coverage, picture.width);
        let noisy = std::mem::replace(&mut picture.images[0], surfaces);
        let covered = denoise(picture)?.into_iter().zip(coverage).map(|(color, share)| color.map(|c| c * share));
        Ok(covered
            .zip(noisy.into_iter().zip(coverage))
            .map(|(own, (noisy, share))| if *share > 0.0 { own } else { noisy })
            .collect())
    };
    let mut layers = vec![(DENOISED.to_owned(), denoise(&mut picture)?)];
    let channels = Aov::Lights.channels(false, false, pixels.light_groups());
    for (i, name) in pixels.light_groups().iter().enumerate() {
        let value = |c: usize, (x, y)| channels[3 * i + c].float(pixels, x, y);
        picture.images[0] = positions(pixels).map(|at| [0, 1, 2].map(|c| value(c, at))).collect();
        layers.push((format!("{DENOISED}_{name}"), denoise(&mut picture)?));
    }
    if let [(_, beauty), lights @ ..] = &mut layers[..] {
        for (i, whole) in beauty.iter().enumerate() {
            for c in 0..3 {
                let sum: f32 = lights.iter().map(|(_, light)| light[i][c]).sum();
                let (whole, equal) = (whole[c], whole[c] / lights.len() as f32);
                let shared = |light: f32| if sum > 0.0 { light / sum * whole } else { equal };
                lights.iter_mut().for_each(|(_, light)| light[i][c] = shared(light[i][c]));
            }
        }
    }
    Ok(layers)
}
