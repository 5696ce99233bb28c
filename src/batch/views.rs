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
use crate::console::Size;
use crate::film::atomic;
use crate::film::exr_file::{CALIBRATION, HeaderValue, WORLD_TO_CAMERA, WORLD_TO_NDC};
use crate::integrator::CameraRays;
use crate::lanes::F;
use crate::render::record::checkpoint::{Earlier, text};
use crate::scene::import::read_text;
use crate::scene::{Calibration, FieldOfView, Orbit, PlacedCamera};
use crate::{Error, Result};

/// Name of the file with the cameras of a data set, in the folder of its pictures.
pub const FILE: &str = "transforms.json";
pub(crate) const MAX_VIEWS: u32 = 100_000;
const FIRST_ORBIT: Orbit = Orbit { azimuth: 0.0, elevation: 20.0, distance: 1.0 };

/// Camera model of panoramas, as nerfstudio names it.
const EQUIRECTANGULAR: &str = "EQUIRECTANGULAR";
/// Camera models of COLMAP and nerfstudio that are OpenCV's perspective camera, with some of its coefficients.
const PERSPECTIVES: [&str; 6] = ["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "FULL_OPENCV", "RADIAL", "SIMPLE_RADIAL"];
/// Those that are OpenCV's fisheye.
const FISHEYES: [&str; 3] = ["OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE"];

macro_rules! intrinsics {
    ($($name:ident: $type:ty),*) => {
        /// Intrinsics of all cameras or of one; lengths in pixels, angles in radians, coefficients of OpenCV.
        #[derive(Debug, Clone, Default, Serialize, Deserialize)]
        #[serde(default)]
        struct Intrinsics {
            $(#[serde(skip_serializing_if = "Option::is_none")] $name: Option<$type>,)*
        }

        impl Intrinsics {
            /// These, and `all` where these state nothing.
            fn or(&self, all: &Self) -> Self {
                Self { $($name: self.$name.clone().or(all.$name.clone()),)* }
            }
        }
    };
}

intrinsics! {
    camera_model: String, is_fisheye: bool, camera_angle_x: f64, camera_angle_y: f64, fl_x: f64, fl_y: f64, cx: f64, cy: f64,
    w: f64, h: f64, k1: f64, k2: f64, k3: f64, k4: f64, k5: f64, k6: f64, p1: f64, p2: f64
}

#[derive(Debug, Serialize, Deserialize)]
struct View {
    #[serde(default)]
    file_path: String,
    /// Four rows, or three without the last one, which is 0, 0, 0, 1.
    transform_matrix: Vec<[f64; 4]>,
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
    pub size: Option<[u32; 2]>,
}

impl Intrinsics {
    /// Those of a calibrated camera, in the pixels of a window of its picture.
    fn of(calibration: &Calibration, [x0, y0, x1, y1]: [f64; 4]) -> Self {
        let Calibration { fisheye, fl_x, fl_y, cx, cy, k, p, .. } = *calibration;
        let model = match (fisheye, calibration.is_linear(), k[3..] == [0.0; 3]) {
            (true, ..) => FISHEYES[0],
            (_, true, _) => "PINHOLE",
            (.., true) => "OPENCV",
            _ => "FULL_OPENCV",
        };
        let [k1, k2, k3, k4, k5, k6] = k.map(|k| Some(k).filter(|k| *k != 0.0));
        let [p1, p2] = p.map(|p| Some(p).filter(|p| *p != 0.0));
        Self {
            camera_model: Some(model.into()),
            k1,
            k2,
            k3,
            k4,
            k5,
            k6,
            p1,
            p2,
            ..Self::linear([fl_x, fl_y], [cx, cy], [x0, y0, x1, y1])
        }
    }

    /// Those of a camera without distortion, likewise.
    fn linear([fl_x, fl_y]: [f64; 2], [cx, cy]: [f64; 2], [x0, y0, x1, y1]: [f64; 4]) -> Self {
        Self {
            camera_angle_x: Some(2.0 * (0.5 * (x1 - x0) / fl_x).atan()),
            camera_angle_y: Some(2.0 * (0.5 * (y1 - y0) / fl_y).atan()),
            fl_x: Some(fl_x),
            fl_y: Some(fl_y),
            cx: Some(cx - x0),
            cy: Some(cy - y0),
            w: Some(x1 - x0),
            h: Some(y1 - y0),
            ..Self::default()
        }
    }

    /// The field of view: by focal lengths, else by angles. A camera whose axis is in the middle, with square pixels and no
    /// distortion, is a plain one.
    fn fov(&self) -> std::result::Result<FieldOfView, String> {
        let model = self.camera_model.as_deref().unwrap_or(PERSPECTIVES[0]);
        let fisheye = self.is_fisheye == Some(true) || FISHEYES.contains(&model);
        if model == EQUIRECTANGULAR {
            return Ok(FieldOfView::Panorama);
        }
        if !fisheye && !PERSPECTIVES.contains(&model) {
            let known = [&PERSPECTIVES[..], &FISHEYES].concat().join(", ");
            return Err(format!("camera_model {model} is not supported: {known} and {EQUIRECTANGULAR} are"));
        }
        let k = [self.k1, self.k2, self.k3, self.k4, self.k5, self.k6].map(Option::unwrap_or_default);
        let p = [self.p1, self.p2].map(Option::unwrap_or_default);
        if fisheye && (k[4..] != [0.0; 2] || p != [0.0; 2]) {
            return Err("a fisheye has the coefficients k1 to k4, and no others".into());
        }
        if model == "OPENCV" && k[3] != 0.0 && self.k5.or(self.k6).is_none() {
            return Err(
                "k4 of the camera_model OPENCV is a polynomial's for nerfstudio and a divisor's for OpenCV: if it is \
                        OpenCV's, write FULL_OPENCV"
                    .into(),
            );
        }
        let by_angle = || Some(0.5 * self.w? / (0.5 * self.camera_angle_x?).tan());
        let fl_x = self.fl_x.or(self.fl_y).or_else(by_angle);
        let fl_y = self.fl_y.or(fl_x);
        let differ = |a: Option<f64>, b: Option<f64>, by: f64| a.zip(b).is_some_and(|(a, b)| (a - b).abs() > by);
        // Through 32-bit matrices, which pictures of plain cameras have in their headers.
        let square = !differ(fl_x, fl_y, 1e-6 * fl_x.unwrap_or_default().abs());
        let middle = |centre: Option<f64>, size: Option<f64>| {
            centre.is_none() || size.is_some() && !differ(centre, size.map(|size| 0.5 * size), 1e-3)
        };
        let centred = middle(self.cx, self.w) && middle(self.cy, self.h);
        if fisheye || !square || !centred || k != [0.0; 6] || p != [0.0; 2] {
            let (Some(w), Some(h), Some(fl_x), Some(fl_y)) = (self.w, self.h, fl_x, fl_y) else {
                return Err("a principal point, a fisheye and distortion need w, h, and fl_x or camera_angle_x".into());
            };
            let (cx, cy) = (self.cx.unwrap_or(0.5 * w), self.cy.unwrap_or(0.5 * h));
            return Ok(FieldOfView::Calibrated(Calibration { fisheye, w, h, fl_x, fl_y, cx, cy, k, p }));
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
/// Errors: [`Error::reading`]; [`Error::Data`] for a file that is no such JSON, and for cameras that cannot be rendered.
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
        let mut to_world = view.transform_matrix.clone();
        if to_world.len() == 3 {
            to_world.push([0.0, 0.0, 0.0, 1.0]);
        }
        let to_world = to_world.try_into().map_err(|_| at("transform_matrix is neither 4 x 4 nor 3 x 4".into()))?;
        let camera = PlacedCamera { name, to_world, fov: intrinsics.fov().map_err(at)? };
        camera.camera(1.0).map_err(|e| at(e.to_string()))?;
        Ok(FileCamera { camera, size: intrinsics.size().map_err(at)? })
    };
    views.frames.iter().enumerate().map(one).collect()
}

/// The field of view that a JSON object states by the names of a camera file; other names are ignored.
pub fn field_of_view(intrinsics: &str) -> Result<FieldOfView> {
    let intrinsics: Intrinsics = serde_json::from_str(intrinsics)
        .map_err(|e| Error::Usage(format!("no intrinsics as in transforms.json: {e}")))?;
    intrinsics.fov().map_err(Error::Usage)
}

/// The intrinsics of a calibrated camera, as a JSON object with the names of a camera file.
pub fn intrinsics(calibration: &Calibration) -> Result<String> {
    let whole = [0.0, 0.0, calibration.w, calibration.h];
    serde_json::to_string(&Intrinsics::of(calibration, whole)).map_err(|e| Error::Bug(e.to_string()))
}

/// The views of a turntable, numbered from 0, that begins with the orbit of the job.
pub(super) fn turntable(job: &Job, count: u32) -> std::result::Result<Vec<Job>, (String, String)> {
    let first = job.request.orbit.unwrap_or(FIRST_ORBIT);
    let view = |k: u32| {
        let mut one = job.numbered(k, "views", false)?;
        let azimuth = first.azimuth + 360.0 * f64::from(k) / f64::from(count);
        (one.request.orbit, one.is_view) = (Some(Orbit { azimuth, ..first }), true);
        Ok(one)
    };
    (0..count).map(view).collect()
}

/// The views of the cameras of a file, numbered from 0, or that of the camera of the job.
pub(super) fn of_file(job: &Job, file: &Path) -> std::result::Result<Vec<Job>, (String, String)> {
    let err = |why: String| ("cameras".to_owned(), format!("`cameras`: {why}"));
    let same = |a: &Path, b: &Path| fs::canonicalize(a).is_ok_and(|a| fs::canonicalize(b).is_ok_and(|b| a == b));
    if same(file, &job.request.output.with_file_name(FILE)) {
        let file = file.display();
        return Err(err(format!("{file} would be written with the pictures: choose another folder for them")));
    }
    let mut cameras = read(file).map_err(|e| err(e.to_string()))?;
    let names: Vec<String> = cameras.iter().map(|c| c.camera.name.clone()).collect();
    let index = |wanted: &String| crate::scene::choose("camera", wanted, &names).map_err(|e| err(e.to_string()));
    let first = job.request.camera.as_ref().map(index).transpose()?;
    if let Some(index) = first {
        cameras = vec![cameras.swap_remove(index)];
    }
    let view = |(FileCamera { camera, size }, number): (FileCamera, u32)| {
        let mut one = job.numbered(number, "views", first.is_some())?;
        let own = size.map(|[width, height]| Size(width, height));
        (one.request.camera, one.request.placed, one.is_view) = (None, Some(camera), true);
        one.request.size = one.request.size.or(own);
        Ok(one)
    };
    cameras.into_iter().zip(first.unwrap_or(0) as u32..).map(view).collect()
}

/// Writes the cameras of pictures into [`FILE`] in their folders, as their headers state them; pictures that are missing, of
/// other programs, or of orthographic cameras are left out. Returns the number of pictures.
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
        // Loaders of the first NeRF data sets read the angle from here only, nerfstudio the model.
        let Intrinsics { camera_angle_x, camera_model, .. } = frames[0].own.clone();
        let all = Intrinsics { camera_angle_x, camera_model, ..Default::default() };
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
    let window = [x0, y0, x1, y1];
    let calibration =
        text(&earlier.header, CALIBRATION).and_then(|text| serde_json::from_str::<Calibration>(text).ok());
    let middle = [0.5 * w, 0.5 * h];
    let own = match (calibration, matrix(WORLD_TO_NDC).map(|to_picture| to_picture * to_camera.inverse())) {
        (Some(calibration), _) => Intrinsics::of(&calibration, window),
        (None, Some(projection)) if projection.row(3).z == 0.0 => return None,
        // Half of the picture's width is 0.5 in NDC.
        (None, Some(projection)) => {
            let lengths = [w * projection.x_axis.x.abs(), h * projection.y_axis.y.abs()];
            Intrinsics::linear(lengths, middle, window)
        }
        // Focal lengths such that nerfstudio's picture coordinates are from -1 to 1 and from -1/2 to 1/2.
        (None, None) => Intrinsics {
            camera_model: Some(EQUIRECTANGULAR.into()),
            camera_angle_x: None,
            camera_angle_y: None,
            ..Intrinsics::linear([0.5 * w, h], middle, window)
        },
    };
    // Camera space of the header looks along +z.
    let to_world = to_camera.inverse() * glam::DMat4::from_scale(glam::DVec3::new(1.0, 1.0, -1.0));
    Some(View {
        file_path: picture.file_name()?.to_string_lossy().into_owned(),
        transform_matrix: to_world.transpose().to_cols_array_2d().into(),
        own,
    })
}

/// The cosine of the angle between the view axis and the ray through the middle of each pixel of a picture, row by row: what
/// makes depth along the axis of depth along the ray.
/// Errors: [`Error::Data`] for pictures of other programs, and of orthographic and panoramic cameras.
pub(crate) fn axis_cosines(picture: &Path) -> Result<Vec<f32>> {
    let wrong = |why: &str| Error::Data(format!("{}: no depth along the view axis: {why}", picture.display()));
    let view = view_of(picture).ok_or_else(|| wrong("its header has no perspective camera"))?;
    let fov = view.own.fov().map_err(|why| wrong(&why))?;
    let (FieldOfView::Vertical(_) | FieldOfView::Calibrated(_), Ok(Some([width, height]))) = (fov, view.own.size())
    else {
        return Err(wrong("it is a panorama"));
    };
    let to_world = glam::DMat4::IDENTITY.to_cols_array_2d();
    let camera = PlacedCamera { name: String::new(), to_world, fov }.camera(f64::from(width) / f64::from(height))?;
    let rays = CameraRays::new(&camera, width, height);
    let cosine = |i: u32| {
        let [x, y] = [i % width, i / width].map(|at| F::splat(at as f32 + 0.5));
        -rays.rays(x, y, F::ZERO).1.lane(0).z
    };
    Ok((0..width * height).map(cosine).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::batch::frames::Sequence;
    use crate::batch::split::split;
    use crate::job::RenderRequest;

    #[test]
    fn a_turntable_is_views_around_the_scene() {
        let request = |preview: &str| RenderRequest {
            output: "o/a.##.exr".into(),
            orbit: "10,30,2".parse().ok(),
            preview: Some(preview.into()),
            ..RenderRequest::default()
        };
        let job = |sequence, preview| Job {
            name: "a".into(),
            request: request(preview),
            sequence: Some(sequence),
            ..Job::default()
        };
        let jobs = split(&job(Sequence::Turntable(4), "a.#.png")).unwrap();
        let orbits: Vec<_> = jobs.iter().map(|job| job.request.orbit.unwrap().to_string()).collect();
        assert_eq!(orbits, ["10,30,2", "100,30,2", "190,30,2", "280,30,2"]);
        let Job { name, request, is_view, .. } = &jobs[3];
        assert_eq!((request.output.to_str(), name.as_str(), is_view), (Some("o/a.03.exr"), "a.0003", &true));
        assert_eq!(request.preview.as_deref(), Some(Path::new("a.3.png")));
        for (sequence, preview, why) in [
            (Sequence::Turntable(3), "a.png", "one file for all views"),
            (Sequence::Cameras("/nowhere.json".into()), "a.#.png", "cannot read"),
        ] {
            let refused = split(&job(sequence, preview)).unwrap_err().1;
            assert!(refused.contains(why), "{refused}");
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
        let calibrated = |head: &str| match read_text(head, "[[1,0,0,1],[0,1,0,2],[0,0,1,3]]").unwrap()[0].camera.fov {
            FieldOfView::Calibrated(of) => of,
            other => panic!("{head}: {other:?}"),
        };
        let of = calibrated(r#""fl_x": 50, "fl_y": 60, "w": 90, "h": 80, "cx": 44, "k1": -0.05, "p2": 0.01,"#);
        assert_eq!((of.fl_x, of.fl_y, of.cx, of.cy, of.fisheye), (50.0, 60.0, 44.0, 40.0, false));
        assert_eq!((of.k, of.p), ([-0.05, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.01]));
        let head = r#""camera_angle_x": 1.0, "w": 90, "h": 80, "camera_model": "OPENCV_FISHEYE","#;
        let of = calibrated(head);
        assert!(of.fisheye && (of.fl_y - 45.0 / 0.5_f64.tan()).abs() < 1e-9);
        assert!(calibrated(&head.replace("\"camera_model\": \"OPENCV_FISHEYE\"", "\"is_fisheye\": true")) == of);
        assert_eq!(field_of_view(&intrinsics(&of).unwrap()).unwrap(), FieldOfView::Calibrated(of));
        for (head, matrix, why) in [
            ("", matrix, "no field of view"),
            (r#""camera_angle_x": 1.0, "k1": 0.1,"#, matrix, "need w, h"),
            (r#""camera_angle_x": 1.0, "cx": 10,"#, matrix, "need w, h"),
            (r#""camera_angle_x": 1.0, "camera_model": "FOV","#, matrix, "camera_model"),
            (r#""camera_angle_x": 1.0, "w": 9, "h": 9, "camera_model": "OPENCV", "k4": 0.1,"#, matrix, "FULL_OPENCV"),
            (
                r#""camera_angle_x": 1.0, "w": 9, "h": 9, "camera_model": "OPENCV_FISHEYE", "p1": 0.1,"#,
                matrix,
                "k1 to k4",
            ),
            (r#""camera_angle_x": 1.5, "w": 9, "h": 9, "k1": -0.4,"#, matrix, "folds the picture at 42.4 degrees"),
            (r#""camera_angle_x": -1.0,"#, matrix, "field of view"),
            (r#""fl_x": -50, "fl_y": 60, "w": 9, "h": 9,"#, matrix, "focal length"),
            (r#""camera_angle_x": 1.0, "w": 0.5, "h": 2,"#, matrix, "no size"),
            (r#""camera_angle_x": 1.0,"#, "[[2,0,0,0],[0,2,0,0],[0,0,2,0],[0,0,0,1]]", "no rotation"),
            (r#""camera_angle_x": 1.0,"#, "[[NaN,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "transforms.json"),
            (r#""camera_angle_x": 1.0,"#, "[[1e400,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]", "transforms.json"),
            (r#""camera_angle_x": 1.0,"#, "[[1,0,0],[0,1,0],[0,0,1]]", "transforms.json"),
            (r#""camera_angle_x": 1.0,"#, "[[1,0,0,0],[0,1,0,0]]", "neither 4 x 4"),
        ] {
            let error = read_text(head, matrix).unwrap_err();
            assert!(error.exit_code() == 65 && error.to_string().contains(why), "{head} {matrix}: {error}");
        }
        fs::write(&path, r#"{"camera_angle_x": 1, "frames": []}"#).unwrap();
        assert!(read(&path).unwrap_err().to_string().contains("no frames"));
    }
}
