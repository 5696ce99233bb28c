//! Cameras that are placed by numbers instead of by the scene's file: on an orbit around the scene, or by a matrix.

use std::fmt::{self, Display};
use std::str::FromStr;

use glam::{Affine3A, DMat3, DMat4, DVec3};

use super::{Calibration, Camera, Framing, Projection, Scene};
use crate::{Error, Result};

/// A view of the whole scene from a point around it. Text form: `AZIMUTH,ELEVATION[,DISTANCE]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Degrees about +y: 0 sees the scene from +z (the front of a glTF asset), 90 from +x.
    pub azimuth: f64,
    /// Degrees above the horizon, −90 to 90.
    pub elevation: f64,
    /// Distance to the centre of the scene, as a multiple of the distance at which the sphere around the scene just fits
    /// into the picture; above 0.
    pub distance: f64,
}

/// Field of view of a [`PlacedCamera`]; angles in degrees, above 0 and below 180.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FieldOfView {
    /// From the bottom to the top of the picture.
    Vertical(f64),
    /// From the left to the right side.
    Horizontal(f64),
    /// All directions: an equirectangular picture with the view axis in its middle.
    Panorama,
    Calibrated(Calibration),
}

/// A camera that is placed by a matrix. Text form: 16 numbers row by row, the field of view with `v` or `h` before it, or
/// `panorama`, or `pinhole` or `fisheye` with the other numbers of a [`Calibration`] after colons; the name; with commas between.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedCamera {
    pub name: String,
    /// Camera to world, row by row: a rotation and a translation in metres. The camera looks along its local −z axis with
    /// +y up, as in glTF.
    pub to_world: [[f64; 4]; 4],
    pub fov: FieldOfView,
}

/// Fields of view in the text form, without their numbers.
const PANORAMA: &str = "panorama";
const CALIBRATED: [&str; 2] = ["pinhole", "fisheye"];

impl Orbit {
    /// Name of its camera.
    pub const NAME: &str = "orbit";

    /// The camera for a picture with this aspect (width over height). It looks at the centre of the scene's bounds with the
    /// vertical field of view [`Framing::YFOV`]. The sphere is the smallest one around that centre which contains every
    /// surface, so that the distance depends on neither angle.
    pub fn camera(&self, scene: &Scene, aspect: f64) -> Camera {
        self.around(scene.enclosing_sphere(), aspect)
    }

    /// The same for a sphere: centre and radius in metres.
    pub fn around(&self, (centre, radius): (DVec3, f64), aspect: f64) -> Camera {
        let vertical = (0.5 * Framing::YFOV).tan();
        let half = vertical.min(vertical * aspect).atan();
        // A point has no extent: it is seen from one metre.
        let reach = if radius > 0.0 { radius / half.sin() } else { 1.0 };
        let (azimuth, elevation) = (self.azimuth.to_radians(), self.elevation.to_radians());
        let z = DVec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos());
        let x = DVec3::new(azimuth.cos(), 0.0, -azimuth.sin());
        let axes = DMat3::from_cols(x, z.cross(x), z).as_mat3();
        let eye = centre + z * (self.distance * reach);
        let projection = Projection::Perspective { yfov: Framing::YFOV as f32 };
        Camera::new(Self::NAME, projection, Affine3A::from_mat3_translation(axes, eye.as_vec3()))
    }
}

impl FromStr for Orbit {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let numbers = text.split(',').map(|n| n.trim().parse().ok().filter(|x: &f64| x.is_finite()));
        let numbers: Option<Vec<f64>> = numbers.collect();
        let (azimuth, elevation, distance) = match numbers.as_deref() {
            Some([azimuth, elevation]) => (*azimuth, *elevation, 1.0),
            Some([azimuth, elevation, distance]) => (*azimuth, *elevation, *distance),
            _ => return Err("not AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,DISTANCE, as in 30,20".into()),
        };
        if elevation.abs() > 90.0 {
            return Err(format!("the elevation is {elevation}, not from -90 to 90 degrees"));
        }
        if !(distance > 0.0 && distance <= 1e6) {
            return Err(format!("the distance is {distance}, not above 0: 1 just shows the whole scene"));
        }
        Ok(Self { azimuth, elevation, distance })
    }
}

impl Display for Orbit {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{},{},{}", self.azimuth, self.elevation, self.distance)
    }
}

impl PlacedCamera {
    /// The camera in a scene, whose [`Scene::origin`] may be another, for a picture with this aspect (width over height).
    ///
    /// # Errors
    /// Those of [`Self::camera`].
    pub fn camera_in(&self, scene: &Scene, aspect: f64) -> Result<Camera> {
        let mut own = self.clone();
        own.to_world.iter_mut().zip(scene.origin.to_array()).for_each(|(row, origin)| row[3] -= origin);
        own.camera(aspect)
    }

    /// The camera for a picture with this aspect (width over height).
    ///
    /// # Errors
    /// [`Error::Usage`] for a matrix that is no rotation and translation, a field of view that is out of range, or a
    /// [`Calibration::fault`].
    pub fn camera(&self, aspect: f64) -> Result<Camera> {
        let Self { name, to_world: rows, fov } = self;
        let wrong = |why: &str| Err(Error::Usage(format!("camera '{name}': {why}")));
        if let FieldOfView::Vertical(degrees) | FieldOfView::Horizontal(degrees) = *fov
            && !(degrees > 0.0 && degrees < 180.0)
        {
            return wrong(&format!("its field of view is {degrees}, not above 0 and below 180 degrees"));
        }
        if let FieldOfView::Calibrated(calibration) = fov
            && let Some(fault) = calibration.fault()
        {
            return wrong(&fault);
        }
        if !rows.iter().flatten().all(|x| x.is_finite()) {
            return wrong("its matrix has numbers that are not finite");
        }
        let matrix = DMat4::from_cols_array_2d(rows).transpose();
        let axes = DMat3::from_mat4(matrix);
        // Rotations that were computed with 32-bit floats are off by about 1e-6.
        let is_rotation = (axes.transpose() * axes).abs_diff_eq(DMat3::IDENTITY, 1e-4) && axes.determinant() > 0.0;
        if !is_rotation || rows[3] != [0.0, 0.0, 0.0, 1.0] {
            return wrong(
                "its matrix is no rotation and translation: three orthonormal, right-handed columns, a position, and the \
                 last row 0, 0, 0, 1",
            );
        }
        let perspective = |yfov: f64| Projection::Perspective { yfov: yfov as f32 };
        let projection = match *fov {
            FieldOfView::Vertical(degrees) => perspective(degrees.to_radians()),
            FieldOfView::Horizontal(degrees) => perspective(2.0 * ((0.5 * degrees.to_radians()).tan() / aspect).atan()),
            FieldOfView::Panorama => Projection::Panorama,
            FieldOfView::Calibrated(calibration) => Projection::Calibrated(calibration),
        };
        let to_world = Affine3A::from_mat3_translation(axes.as_mat3(), matrix.w_axis.truncate().as_vec3());
        let aspect = (projection == Projection::Panorama).then_some(2.0);
        Ok(Camera { aspect, ..Camera::new(name, projection, to_world) })
    }
}

impl FromStr for PlacedCamera {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = "not 16 numbers, a field of view and a name, separated by commas";
        let parts: Vec<&str> = text.splitn(18, ',').collect();
        let [numbers @ .., fov, name] = &parts[..] else { return Err(wrong.into()) };
        let numbers: Option<Vec<f64>> = numbers.iter().map(|x| x.parse().ok()).collect();
        let flat: [f64; 16] = numbers.and_then(|numbers| numbers.try_into().ok()).ok_or(wrong)?;
        let of = |kind: char| fov.strip_prefix(kind).and_then(|degrees| degrees.parse().ok());
        let panorama = (*fov == PANORAMA).then_some(FieldOfView::Panorama);
        let calibrated = || {
            let (kind, numbers) = fov.split_once(':')?;
            let numbers: Option<Vec<f64>> = numbers.split(':').map(|x| x.parse().ok()).collect();
            let &[w, h, fl_x, fl_y, cx, cy, k1, k2, k3, k4, k5, k6, p1, p2] = &numbers?[..] else { return None };
            let fisheye = CALIBRATED.iter().position(|name| *name == kind)? == 1;
            let (k, p) = ([k1, k2, k3, k4, k5, k6], [p1, p2]);
            Some(FieldOfView::Calibrated(Calibration { fisheye, w, h, fl_x, fl_y, cx, cy, k, p }))
        };
        let angle = of('v').map(FieldOfView::Vertical).or(of('h').map(FieldOfView::Horizontal));
        let fov = angle.or(panorama).or_else(calibrated);
        let fov = fov.ok_or(wrong)?;
        let to_world = std::array::from_fn(|row| std::array::from_fn(|column| flat[4 * row + column]));
        Ok(Self { name: (*name).into(), to_world, fov })
    }
}

impl Display for PlacedCamera {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.to_world.iter().flatten().try_for_each(|x| write!(f, "{x},"))?;
        match self.fov {
            FieldOfView::Vertical(degrees) => write!(f, "v{degrees},{}", self.name),
            FieldOfView::Horizontal(degrees) => write!(f, "h{degrees},{}", self.name),
            FieldOfView::Panorama => write!(f, "{PANORAMA},{}", self.name),
            FieldOfView::Calibrated(Calibration { fisheye, w, h, fl_x, fl_y, cx, cy, k, p }) => {
                write!(f, "{}", CALIBRATED[usize::from(fisheye)])?;
                let numbers = [w, h, fl_x, fl_y, cx, cy].into_iter().chain(k).chain(p);
                numbers.into_iter().try_for_each(|x| write!(f, ":{x}"))?;
                write!(f, ",{}", self.name)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, vec3};

    use super::*;
    use crate::scene::{Material, Mesh};

    fn scene() -> Scene {
        let mut scene = Scene::default();
        let corners = vec![[4.0, 0.0, 0.0], [6.0, 0.0, 0.0], [6.0, 3.0, 1.0], [4.0, 3.0, -1.0]];
        scene.add(Mesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]), Material::default());
        scene
    }

    #[test]
    fn an_orbit_sees_the_whole_scene_from_its_side_at_one_distance() {
        let scene = scene();
        let centre = vec3(5.0, 1.5, 0.0);
        let mut distances = Vec::new();
        for (azimuth, elevation) in [(0.0, 0.0), (90.0, 0.0), (200.0, 35.0), (-30.0, 90.0), (10.0, -90.0)] {
            for aspect in [0.5, 1.0, 2.0] {
                let camera = Orbit { azimuth, elevation, distance: 1.0 }.camera(&scene, aspect);
                let to_camera = camera.to_world.inverse();
                let middle = to_camera.transform_point3(centre);
                assert!(middle.truncate().length() < 1e-4 && middle.z < 0.0, "{middle}");
                let half = (0.5 * Framing::YFOV as f32).tan();
                for p in scene.meshes[0].positions.iter() {
                    let p = to_camera.transform_point3(Vec3::from_array(*p));
                    assert!(p.y.abs() <= -p.z * half && p.x.abs() <= -p.z * half * aspect as f32);
                }
                // +y is up in the picture.
                assert!(to_camera.transform_vector3(Vec3::Y).y > -1e-6);
                distances.push((aspect, -middle.z));
            }
        }
        assert!(distances.iter().all(|(aspect, d)| (d - distances[usize::from(*aspect > 0.5)].1).abs() < 1e-4));
        let eye = |azimuth| Orbit { azimuth, elevation: 0.0, distance: 1.0 }.camera(&scene, 1.0).to_world.translation;
        assert!(eye(0.0).z > 1.0 && eye(90.0).x > 6.0);
    }

    #[test]
    fn texts_are_read_as_they_are_written_or_refused() {
        let orbit: Orbit = "30, -20".parse().unwrap();
        assert_eq!(orbit, Orbit { azimuth: 30.0, elevation: -20.0, distance: 1.0 });
        assert_eq!(orbit.to_string().parse(), Ok(orbit));
        for bad in ["", "1", "1,2,3,4", "0,91", "nan,0", "0,0,0", "0,0,-1", "0,inf"] {
            assert!(bad.parse::<Orbit>().is_err(), "{bad}");
        }
        let rows = [[1.0, 0.0, 0.0, 0.1], [0.0, 1.0, 0.0, 1e-9], [0.0, 0.0, 1.0, -3.0], [0.0, 0.0, 0.0, 1.0]];
        let placed = PlacedCamera { name: "a,b".into(), to_world: rows, fov: FieldOfView::Horizontal(50.0) };
        assert_eq!(placed.to_string().parse(), Ok(placed.clone()));
        let around = PlacedCamera { fov: FieldOfView::Panorama, ..placed.clone() };
        assert_eq!(around.to_string().parse(), Ok(around.clone()));
        assert_eq!(around.camera(2.0).unwrap().projection, Projection::Panorama);
        let (k, p) = ([-0.1, 0.02, 0.0, 1e-3, 0.0, 0.0], [1e-4, 0.0]);
        let of =
            |fisheye, k, p| Calibration { fisheye, w: 64.0, h: 48.0, fl_x: 70.1, fl_y: 69.5, cx: 30.0, cy: 25.5, k, p };
        for of in [of(false, k, p), of(true, [0.0; 6], [0.0; 2])] {
            let measured = PlacedCamera { fov: FieldOfView::Calibrated(of), ..placed.clone() };
            assert_eq!(measured.to_string().parse(), Ok(measured.clone()));
            assert_eq!(measured.camera(2.0).unwrap().natural_aspect(), Some(64.0 / 48.0));
        }
        for bad in [
            "",
            "1,2,v3,name",
            "x,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,v3,name",
            "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,fisheye:1,a",
        ] {
            assert!(bad.parse::<PlacedCamera>().is_err(), "{bad}");
        }
        let Projection::Perspective { yfov } = placed.camera(2.0).unwrap().projection else { panic!() };
        assert!((f64::from(yfov / 2.0).tan() * 2.0 - 25_f64.to_radians().tan()).abs() < 1e-6);
        let mirrored = PlacedCamera { to_world: [[-1.0, 0.0, 0.0, 0.0], rows[1], rows[2], rows[3]], ..placed.clone() };
        assert!(mirrored.camera(1.0).unwrap_err().to_string().contains("right-handed"));
    }
}
