//! Many views of one scene: turntables, and cameras from files in the convention of NeRF's `transforms.json`, which are also
//! written. Axes are those of glTF and OpenGL: a camera looks along its local −z axis with +y up; matrices are camera to
//! world.

use std::collections::BTreeSet;
use std::fs;
use std::io::Write;
use std::path::Path;

use glam::Mat4;
use serde::{Deserialize, Serialize};

use super::job::Job;
use super::numbering::{OTHER_OUTPUTS, numbered, numbered_name, with_placeholder};
use crate::film::atomic;
use crate::film::exr_file::{HeaderValue, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::render::checkpoint::Earlier;
use crate::scene::import::read_text;
use crate::scene::{FieldOfView, Orbit, PlacedCamera};
use crate::{Error, Result};

/// Name of the file with the cameras of a data set, in the folder of its pictures.
pub const FILE: &str = "transforms.json";
/// Largest number of views of a turntable.
pub const MAX_VIEWS: u32 = 100_000;
/// Flags that make one job many.
pub const SPLITTING: [&str; 2] = ["turntable", "cameras"];

/// Camera model of panoramas, as nerfstudio names it.
const EQUIRECTANGULAR: &str = "EQUIRECTANGULAR";
/// Camera models without lens distortion, or whose distortion coefficients must be 0.
const PINHOLES: [&str; 6] = ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "FULL_OPENCV", "RADIAL", "SIMPLE_RADIAL"];

/// Intrinsics of all cameras or of one; lengths in pixels, angles in radians. Distortion must be 0.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(default)]
struct Intrinsics {
    /// `PINHOLE` and its like, or [`EQUIRECTANGULAR`].
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_model: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_angle_x: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    camera_angle_y: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fl_x: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fl_y: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cx: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cy: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    w: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    h: Option<f64>,
    #[serde(skip_serializing)]
    k1: f64,
    #[serde(skip_serializing)]
    k2: f64,
    #[serde(skip_serializing)]
    k3: f64,
    #[serde(skip_serializing)]
    k4: f64,
    #[serde(skip_serializing)]
    p1: f64,
    #[serde(skip_serializing)]
    p2: f64,
}

#[derive(Debug, Serialize, Deserialize)]
struct View {
    #[serde(default)]
    file_path: String,
    transform_matrix: [[f64; 4]; 4],
    #[serde(flatten)]
    own: Intrinsics,
}

#[derive(Debug, Serialize, Deserialize)]
struct Views {
    /// The program that has written the file.
    #[serde(default)]
    generator: String,
    #[serde(flatten)]
    all: Intrinsics,
    frames: Vec<View>,
}

/// A camera of a file, with its picture's size in pixels if the file states it.
#[derive(Debug, Clone, PartialEq)]
pub struct FileCamera {
    /// The camera, named by its picture's file without folder and extension, else by its index.
    pub camera: PlacedCamera,
    /// Width and height in pixels.
    pub size: Option<[u32; 2]>,
}

impl Intrinsics {
    /// These, and `all` where these state nothing.
    fn or(&self, all: &Self) -> Self {
        let distortion = |own: f64, all: f64| if own == 0.0 { all } else { own };
        Self {
            camera_model: self.camera_model.clone().or(all.camera_model.clone()),
            camera_angle_x: self.camera_angle_x.or(all.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(all.camera_angle_y),
            fl_x: self.fl_x.or(all.fl_x),
            fl_y: self.fl_y.or(all.fl_y),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            k1: distortion(self.k1, all.k1),
            k2: distortion(self.k2, all.k2),
            k3: distortion(self.k3, all.k3),
            k4: distortion(self.k4, all.k4),
            p1: distortion(self.p1, all.p1),
            p2: distortion(self.p2, all.p2),
        }
    }

    /// The field of view: by focal lengths, else by angles.
    fn fov(&self) -> std::result::Result<FieldOfView, String> {
        match self.camera_model.as_deref() {
            Some(EQUIRECTANGULAR) => return Ok(FieldOfView::Panorama),
            Some(model) if !PINHOLES.contains(&model) => {
                let known = PINHOLES.join(", ");
                return Err(format!("camera_model {model} is not supported: {known} and {EQUIRECTANGULAR} are"));
            }
            _ => {}
        }
        if [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2].iter().any(|k| *k != 0.0) {
            return Err("lens distortion (k1 to k4, p1, p2) is not supported: undistort the cameras".into());
        }
        if let (Some(x), Some(y)) = (self.fl_x, self.fl_y)
            && (x - y).abs() > 1e-3 * x.abs()
        {
            return Err(format!("fl_x is {x} and fl_y is {y}: pixels that are not square are not supported"));
        }
        for (name, centre, size) in [("cx", self.cx, self.w), ("cy", self.cy, self.h)] {
            if let (Some(centre), Some(size)) = (centre, size)
                && (centre - 0.5 * size).abs() > 0.5
            {
                let middle = 0.5 * size;
                return Err(format!("{name} is {centre}, not the middle {middle}: shifted lenses are not supported"));
            }
        }
        let angle = |size: f64, length: f64| (2.0 * (0.5 * size / length).atan()).to_degrees();
        match (self.fl_y.or(self.fl_x), self.h, self.fl_x.or(self.fl_y), self.w) {
            (Some(length), Some(size), ..) => Ok(FieldOfView::Vertical(angle(size, length))),
            (.., Some(length), Some(size)) => Ok(FieldOfView::Horizontal(angle(size, length))),
            _ => match (self.camera_angle_x, self.camera_angle_y) {
                (Some(x), _) => Ok(FieldOfView::Horizontal(x.to_degrees())),
                (None, Some(y)) => Ok(FieldOfView::Vertical(y.to_degrees())),
                (None, None) => Err("no field of view: camera_angle_x, or fl_x and w, or fl_y and h".into()),
            },
        }
    }

    fn size(&self) -> std::result::Result<Option<[u32; 2]>, String> {
        let (Some(w), Some(h)) = (self.w, self.h) else { return Ok(None) };
        let whole = |x: f64| x >= 1.0 && x <= f64::from(u16::MAX) && x.fract() == 0.0;
        if whole(w) && whole(h) {
            Ok(Some([w as u32, h as u32]))
        } else {
            Err(format!("w is {w} and h is {h}: no size"))
        }
    }
}

/// Reads the cameras of a file.
///
/// # Errors
/// [`Error::reading`]; [`Error::Data`] for a file that is no such JSON, and for cameras that cannot be rendered.
pub fn read(path: &Path) -> Result<Vec<FileCamera>> {
    let wrong = |why: String| Error::Data(format!("{}: {why}", path.display()));
    let bytes = read_text(path)?;
    let views: Views =
        serde_json::from_slice(&bytes).map_err(|e| wrong(format!("not cameras as in NeRF's transforms.json: {e}")))?;
    if views.frames.is_empty() {
        return Err(wrong("it has no frames".into()));
    }
    let one = |(index, view): (usize, &View)| -> Result<FileCamera> {
        let at = |why: String| wrong(format!("frames[{index}]: {why}"));
        let stem = Path::new(&view.file_path).file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let name = stem.filter(|stem| !stem.is_empty()).unwrap_or_else(|| index.to_string());
        let intrinsics = view.own.or(&views.all);
        let camera = PlacedCamera { name, to_world: view.transform_matrix, fov: intrinsics.fov().map_err(at)? };
        camera.camera(1.0).map_err(|e| at(e.to_string()))?;
        Ok(FileCamera { camera, size: intrinsics.size().map_err(at)? })
    };
    views.frames.iter().enumerate().map(one).collect()
}

/// Splits a job with `turntable` or `cameras` into one job per view; returns other jobs unchanged. Views are numbered from 0.
///
/// # Errors
/// A flag and what is wrong with it.
pub fn split(job: Job) -> std::result::Result<Vec<Job>, (String, String)> {
    let Some(at) = job.flags.iter().position(|(name, _)| SPLITTING.contains(&name.as_str())) else {
        return Ok(vec![job]);
    };
    let mut job = job;
    let (flag, text) = job.flags.remove(at);
    let text = text.unwrap_or_default();
    let err = |why: String| (flag.clone(), format!("`{flag}`: {why}"));
    let mut take = |name: &str| {
        let at = job.flags.iter().position(|(flag, _)| flag == name)?;
        job.flags.remove(at).1
    };
    if take("frames").is_some() || SPLITTING.iter().any(|other| take(other).is_some()) {
        return Err(err("only one of `frames`, `turntable` and `cameras` can make a sequence".into()));
    }
    let (views, single) = if flag == "turntable" {
        let count: u32 = text
            .parse()
            .ok()
            .filter(|n| (1..=MAX_VIEWS).contains(n))
            .ok_or_else(|| err(format!("'{text}' is not a number of views from 1 to {MAX_VIEWS}")))?;
        let first: Orbit = take("orbit").unwrap_or("0,20".into()).parse().map_err(err)?;
        let orbit = |k: u32| Orbit { azimuth: first.azimuth + 360.0 * f64::from(k) / f64::from(count), ..first };
        let views = (0..count).map(|k| (k, vec![("orbit".to_owned(), orbit(k).to_string())]));
        (views.collect::<Vec<_>>(), false)
    } else {
        let file = Path::new(&text);
        let same = |a: &Path, b: &Path| fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b));
        if same(file, &job.output.with_file_name(FILE)) {
            return Err(err(format!("{text} would be written with the pictures: choose another folder for them")));
        }
        let mut cameras = read(file).map_err(|e| err(e.to_string()))?;
        let names: Vec<String> = cameras.iter().map(|c| c.camera.name.clone()).collect();
        let chosen = take("camera");
        let index = |wanted: &String| crate::scene::choose("camera", wanted, &names).map_err(|e| err(e.to_string()));
        let first = chosen.as_ref().map(index).transpose()?;
        if let Some(index) = first {
            cameras = vec![cameras.swap_remove(index)];
        }
        let has_size = job.flags.iter().any(|(name, _)| name == "size");
        let views = cameras.iter().zip(first.unwrap_or(0) as u32..).map(|(FileCamera { camera, size }, number)| {
            let mut flags = vec![("placed".to_owned(), camera.to_string())];
            flags.extend(size.filter(|_| !has_size).map(|[w, h]| ("size".to_owned(), format!("{w}x{h}"))));
            (number, flags)
        });
        (views.collect(), first.is_some())
    };
    let number = |file: &Path, name: &str, view| {
        let why = "names one file for all views; write their number as #### or {frame:04}";
        let path = numbered(file, view).or(single.then(|| file.to_owned()));
        path.ok_or_else(|| (name.to_owned(), format!("`{name}`: {} {why}", file.display())))
    };
    let one = |(view, flags): (u32, Vec<(String, String)>)| -> std::result::Result<Job, (String, String)> {
        let mut one = job.clone();
        one.name = numbered_name(&with_placeholder(job.name.clone()), view).unwrap_or_default();
        one.output = number(&job.output, "output", view)?;
        for (name, value) in one.flags.iter_mut().filter(|(name, _)| OTHER_OUTPUTS.contains(&name.as_str())) {
            let Some(file) = value else { continue };
            *file = number(Path::new(&file), name, view)?.to_string_lossy().into_owned();
        }
        one.flags.extend(flags.into_iter().map(|(name, value)| (name, Some(value))));
        one.is_view = true;
        Ok(one)
    };
    views.into_iter().map(one).collect()
}

/// Writes the cameras of pictures into [`FILE`] in their folders, as their headers state them; pictures that are missing, of
/// other programs, or of orthographic cameras are left out. Returns the number of pictures.
///
/// # Errors
/// Those of [`atomic::write`].
pub fn write<'a>(pictures: impl Iterator<Item = &'a Path>) -> Result<usize> {
    let pictures: Vec<&Path> = pictures.collect();
    let folders: BTreeSet<&Path> = pictures.iter().filter_map(|picture| picture.parent()).collect();
    let mut count = 0;
    for folder in folders {
        let ours = pictures.iter().filter(|picture| picture.parent() == Some(folder));
        let frames: Vec<View> = ours.filter_map(|picture| view_of(picture)).collect();
        if frames.is_empty() {
            continue;
        }
        count += frames.len();
        // Loaders of the first NeRF data sets read the angle from here only.
        let all = Intrinsics { camera_angle_x: frames[0].own.camera_angle_x, ..Default::default() };
        atomic::write(&folder.join(FILE), |file| {
            serde_json::to_writer_pretty(&mut *file, &Views { generator: "bismar".into(), all, frames })?;
            file.write_all(b"\n")?;
            Ok(Ok(()))
        })?;
    }
    Ok(count)
}

/// The camera of a picture, from its header.
fn view_of(picture: &Path) -> Option<View> {
    let earlier = Earlier::read(picture).ok()??;
    let matrix = |name: &str| {
        earlier.header.iter().find_map(|(other, value)| match value {
            HeaderValue::Matrix(m) if other == name => Some(Mat4::from_cols_array(m).as_dmat4()),
            _ => None,
        })
    };
    let to_camera = matrix(WORLD_TO_CAMERA)?;
    let settings = &earlier.record.identity.settings;
    let (w, h) = (f64::from(settings.width), f64::from(settings.height));
    // The file has the pixels of the crop.
    let [x0, y0, x1, y1] = settings.window().map(f64::from);
    let (cx, cy) = (Some(0.5 * w - x0), Some(0.5 * h - y0));
    let size = Intrinsics { cx, cy, w: Some(x1 - x0), h: Some(y1 - y0), ..Default::default() };
    let own = match matrix(WORLD_TO_NDC).map(|to_picture| to_picture * to_camera.inverse()) {
        Some(projection) if projection.row(3).z == 0.0 => return None,
        Some(projection) => {
            // Half of the picture's width is 0.5 in NDC.
            let (fl_x, fl_y) = (w * projection.x_axis.x.abs(), h * projection.y_axis.y.abs());
            Intrinsics {
                camera_angle_x: Some(2.0 * (0.5 * (x1 - x0) / fl_x).atan()),
                camera_angle_y: Some(2.0 * (0.5 * (y1 - y0) / fl_y).atan()),
                fl_x: Some(fl_x),
                fl_y: Some(fl_y),
                ..size
            }
        }
        // Focal lengths such that nerfstudio's picture coordinates are from -1 to 1 and from -1/2 to 1/2.
        None => Intrinsics { camera_model: Some(EQUIRECTANGULAR.into()), fl_x: Some(0.5 * w), fl_y: Some(h), ..size },
    };
    // Camera space of the header looks along +z.
    let to_world = to_camera.inverse() * glam::DMat4::from_scale(glam::DVec3::new(1.0, 1.0, -1.0));
    Some(View {
        file_path: picture.file_name()?.to_string_lossy().into_owned(),
        transform_matrix: to_world.transpose().to_cols_array_2d(),
        own,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn job(flags: &[(&str, &str)]) -> Job {
        let flags = flags.iter().map(|(name, value)| ((*name).into(), Some((*value).into()))).collect();
        Job { name: "a".into(), scene: "a.glb".into(), flags, output: "o/a.##.exr".into(), ..Job::default() }
    }

    #[test]
    fn a_turntable_is_views_around_the_scene() {
        let jobs = split(job(&[("turntable", "4"), ("orbit", "10,30,2"), ("preview", "a.#.png")])).unwrap();
        let orbits: Vec<_> = jobs.iter().map(|j| j.flags.iter().find(|f| f.0 == "orbit").unwrap().1.clone()).collect();
        assert_eq!(orbits, ["10,30,2", "100,30,2", "190,30,2", "280,30,2"].map(|o| Some(o.into())));
        assert_eq!((jobs[3].output.to_str(), jobs[3].name.as_str()), (Some("o/a.03.exr"), "a.0003"));
        assert!(jobs[3].flags.contains(&("preview".into(), Some("a.3.png".into()))) && jobs[3].is_view);
        for (bad, why) in [
            (vec![("turntable", "0")], "number of views"),
            (vec![("turntable", "3"), ("frames", "1-2")], "only one of"),
            (vec![("turntable", "3"), ("cameras", "x.json")], "only one of"),
            (vec![("turntable", "3"), ("orbit", "1")], "AZIMUTH"),
            (vec![("turntable", "3"), ("preview", "a.png")], "one file for all views"),
            (vec![("cameras", "/nowhere.json")], "cannot read"),
        ] {
            assert!(split(job(&bad)).unwrap_err().1.contains(why), "{bad:?}: {:?}", split(job(&bad)));
        }
    }

    #[test]
    fn cameras_of_both_conventions_are_read_and_others_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.json");
        let matrix = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";
        let read_text = |head: &str, matrix: &str| {
            let frame = format!(r#"{{"file_path": "./train/r_7.png", "rotation": 0.1, "transform_matrix": {matrix}}}"#);
            fs::write(&path, format!(r#"{{{head} "frames": [{frame}]}}"#)).unwrap();
            read(&path)
        };
        let one = &read_text(r#""camera_angle_x": 1.0,"#, matrix).unwrap()[0];
        assert_eq!((one.camera.name.as_str(), one.size), ("r_7", None));
        assert_eq!(one.camera.fov, FieldOfView::Horizontal(1_f64.to_degrees()));
        assert_eq!(one.camera.to_world[1][3], 2.0);
        let two = &read_text(r#""fl_x": 50, "fl_y": 50, "w": 100, "h": 100, "cx": 50, "cy": 50, "k1": 0.0,"#, matrix);
        let two = &two.as_ref().unwrap()[0];
        assert!(matches!(two.camera.fov, FieldOfView::Vertical(d) if (d - 90.0).abs() < 1e-9));
        assert_eq!(two.size, Some([100, 100]));
        let around = &read_text(r#""camera_model": "EQUIRECTANGULAR", "w": 64, "h": 32,"#, matrix).unwrap()[0];
        assert_eq!((around.camera.fov, around.size), (FieldOfView::Panorama, Some([64, 32])));
        for (head, matrix, why) in [
            ("", matrix, "no field of view"),
            (r#""camera_angle_x": 1.0, "k1": 0.1,"#, matrix, "distortion"),
            (r#""camera_angle_x": 1.0, "camera_model": "OPENCV_FISHEYE","#, matrix, "camera_model"),
            (r#""camera_angle_x": -1.0,"#, matrix, "field of view"),
            (r#""fl_x": 50, "fl_y": 60, "w": 9, "h": 9,"#, matrix, "square"),
            (r#""fl_x": 50, "w": 90, "h": 9, "cx": 1,"#, matrix, "shifted"),
            (r#""camera_angle_x": 1.0, "w": 0.5, "h": 2,"#, matrix, "no size"),
            (r#""camera_angle_x": 1.0,"#, "[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]", "no rotation"),
            (r#""camera_angle_x": 1.0,"#, "[[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "transforms.json"),
            (r#""camera_angle_x": 1.0,"#, "[[1e400,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "transforms.json"),
            (r#""camera_angle_x": 1.0,"#, "[[1,0,0],[0,1,0],[0,0,1]]", "transforms.json"),
        ] {
            let error = read_text(head, matrix).unwrap_err();
            assert!(error.exit_code() == 65 && error.to_string().contains(why), "{head} {matrix}: {error}");
        }
        fs::write(&path, r#"{"camera_angle_x": 1, "frames": []}"#).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("no frames"));
    }
}
