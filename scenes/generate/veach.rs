//! After Eric Veach's test of multiple importance sampling (Robust Monte Carlo Methods for Light Transport Simulation,
//! 1997, section 9.3.1): metal plates that grow rougher, each turned to mirror four area lights of equal power and unequal
//! size towards the camera.

use glam::{DVec3, dvec3};

use crate::glb::{Glb, Material, Placement};
use crate::mesh::{quad, sphere};

pub fn scene() -> Glb {
    let mut glb = Glb::default();
    let eye = dvec3(0.0, 2.0, 7.4);
    let emitters = dvec3(0.0, 2.3, -1.6);
    let ball = glb.geometry(&sphere(1.0, 32));
    for (name, x, radius, tint) in [
        ("lamp, tiny", -2.1, 0.033, [1.0, 0.62, 0.42]),
        ("lamp, small", -0.75, 0.1, [0.95, 0.95, 0.6]),
        ("lamp, middling", 0.65, 0.3, [0.6, 1.0, 0.75]),
        ("lamp, large", 2.2, 0.6, [0.6, 0.75, 1.0]),
    ] {
        // Radiance for the same power whatever the size.
        let emitter = glb.material(&Material::emitter(name, tint.map(|c: f64| c * 2.0 / (radius * radius))));
        glb.shared(name, &ball, emitter, &Placement::scaled(emitters.with_x(x), radius));
    }
    for (name, alpha, y, z) in [
        ("plate, rough", 0.30, -0.95, 1.85),
        ("plate, satin", 0.12, -0.70, 0.95),
        ("plate, glossy", 0.04, -0.30, 0.10),
        ("plate, smooth", 0.012, 0.25, -0.65),
    ] {
        let centre = dvec3(0.0, y, z);
        let normal = ((eye - centre).normalize() + (emitters - centre).normalize()).normalize();
        let up = normal.cross(DVec3::X).normalize() * 0.36;
        let side = DVec3::X * 2.5;
        // glTF's roughness is the root of the microfacet alpha.
        let metal = glb.material(&Material::metal(name, [0.78, 0.78, 0.80], f64::sqrt(alpha)));
        let corners = [centre - side - up, centre + side - up, centre + side + up, centre - side + up];
        glb.object(name, &quad(corners), metal);
    }
    let grey = glb.material(&Material::lambert("grey", [0.22; 3]));
    let (x, floor, near, far, top) = (12.0, -1.5, 10.0, -4.0, 9.0);
    let ground = [dvec3(-x, floor, near), dvec3(x, floor, near), dvec3(x, floor, far), dvec3(-x, floor, far)];
    let wall = [dvec3(-x, floor, far), dvec3(x, floor, far), dvec3(x, top, far), dvec3(-x, top, far)];
    glb.object("floor", &quad(ground), grey);
    glb.object("wall", &quad(wall), grey);
    glb.camera("camera", eye, dvec3(0.0, 0.62, 0.0), 34.0, 1.5);
    glb
}
