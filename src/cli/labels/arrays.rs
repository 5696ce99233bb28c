//! Depth and normals of a picture as arrays beside it.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::{Mat4, Vec3};

use crate::batch::views::axis_cosines;
use crate::console::Paths;
use crate::film::exr_file::{HeaderValue, WORLD_TO_CAMERA, read_header};
use crate::film::{Picture, npy, preview};
use crate::{Error, Result};

/// Depth and normals.
#[derive(Debug, Args)]
pub struct ArrayArgs {
    /// Also write the depth: npy (float32, metres, 1e10 where nothing is), png (16 bit, 0 where nothing is).
    #[arg(long, value_enum, value_delimiter = ',', value_name = "FORMATS")]
    depth: Vec<Format>,
    /// Metres per step of the PNG of --depth; 0.001 reaches 65.5 m.
    #[arg(long, value_name = "METRES", default_value_t = 0.001, value_parser = scale)]
    depth_scale: f32,
    /// What --depth measures.
    #[arg(long, value_enum, default_value_t)]
    depth_along: Along,
    /// Also write the normals: npy (float32), png (16 bit, (value - 32768) / 32767 in each channel); 0 where nothing is.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "FORMATS")]
    normals: Vec<Format>,
    /// Axes of --normals.
    #[arg(long, value_enum, default_value_t)]
    normal_space: Space,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// NumPy's
    Npy,
    /// 16 bits per channel
    Png,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum Space {
    /// The scene's axes
    #[default]
    World,
    /// +x to the right, +y up, +z toward the viewer
    Camera,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
enum Along {
    /// Distances to the camera, as depth.Z has them
    #[default]
    Ray,
    /// Along the view axis, as depth cameras measure
    Axis,
}

/// Depth of pixels without a hit.
const NOTHING: f32 = 1e10;

fn scale(text: &str) -> std::result::Result<f32, String> {
    let scale = text.parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale > 0.0);
    scale.ok_or_else(|| "must be a number above 0".into())
}

impl Format {
    /// The name of the array `what` of a picture.
    fn path(self, picture: &Path, what: &str) -> PathBuf {
        picture.with_extension(format!("{what}.{}", if self == Self::Npy { "npy" } else { "png" }))
    }
}

impl ArrayArgs {
    /// Writes the arrays of a picture beside it.
    /// Errors: [`Error::Data`] for a picture without the AOV, or a depth beyond the PNG's range; those of reading and
    /// writing.
    pub fn write(&self, picture: &Path, paths: &mut Paths) -> Result<()> {
        if !self.depth.is_empty() {
            let (size, values) = layer(picture, "depth")?;
            let mut values: Vec<f32> = values.iter().map(|value| value[0]).collect();
            if self.depth_along == Along::Axis {
                let hits = values.iter_mut().zip(axis_cosines(picture)?).filter(|(depth, _)| **depth < NOTHING);
                hits.for_each(|(depth, cosine)| *depth *= cosine);
            }
            for format in &self.depth {
                let path = format.path(picture, "depth");
                paths.writes("--depth", &path)?;
                match format {
                    Format::Npy => npy::write(&path, &[size[1], size[0]], &values)?,
                    Format::Png => {
                        let steps = steps(&values, self.depth_scale, picture)?;
                        preview::write_png16(&path, size.map(|n| n as u32), &steps)?;
                    }
                }
            }
        }
        if !self.normals.is_empty() {
            let (size, mut values) = layer(picture, "normal")?;
            if self.normal_space == Space::Camera {
                let to_camera = to_camera(picture)?;
                values.iter_mut().for_each(|n| *n = to_camera.transform_vector3(Vec3::from(*n)).into());
            }
            let values = values.as_flattened();
            for format in &self.normals {
                let path = format.path(picture, "normal");
                paths.writes("--normals", &path)?;
                match format {
                    Format::Npy => npy::write(&path, &[size[1], size[0], 3], values)?,
                    Format::Png => {
                        let values: Vec<u16> = values.iter().map(|x| (32768.0 + 32767.0 * x).round() as u16).collect();
                        preview::write_png16(&path, size.map(|n| n as u32), &values)?;
                    }
                }
            }
        }
        Ok(())
    }
}

/// Width and height, and the values of a layer row by row; a single channel three times.
fn layer(path: &Path, name: &str) -> Result<([usize; 2], Vec<[f32; 3]>)> {
    match Picture::open(path, Some(name)) {
        Ok(picture) => Ok((picture.size(), picture.rgb)),
        Err(Error::Data(why)) => Err(Error::Data(format!("{why}: render it with --aov {name}"))),
        Err(other) => Err(other),
    }
}

/// Depths in steps, rounded; at least 1, because 0 is nothing.
fn steps(depths: &[f32], scale: f32, picture: &Path) -> Result<Vec<u16>> {
    let hits = depths.iter().filter(|depth| **depth < NOTHING);
    let farthest = hits.fold(0.0_f32, |farthest, depth| farthest.max(*depth));
    if farthest / scale > f32::from(u16::MAX) {
        return Err(Error::Data(format!(
            "{}: a depth of {farthest} m is beyond 65535 steps of {scale} m: give --depth-scale {:.2e} or more",
            picture.display(),
            farthest / f32::from(u16::MAX) * 1.01
        )));
    }
    let step = |depth: &f32| if *depth < NOTHING { (depth / scale).round().max(1.0) as u16 } else { 0 };
    Ok(depths.iter().map(step).collect())
}

/// From world to glTF's camera axes, which look along -z.
fn to_camera(path: &Path) -> Result<Mat4> {
    let header = read_header(path)?;
    let matrix = header.iter().find_map(|(name, value)| match value {
        HeaderValue::Matrix(m) if name == WORLD_TO_CAMERA => Some(Mat4::from_cols_array(m)),
        _ => None,
    });
    let missing = || Error::Data(format!("{}: its header has no {WORLD_TO_CAMERA}", path.display()));
    // The header's camera looks along +z.
    matrix.map(|m| Mat4::from_scale(Vec3::new(1.0, 1.0, -1.0)) * m).ok_or_else(missing)
}
