//! What lies between ray queries and stages: back faces and thin walls that rays pass, shadows of glass, camera rays for
//! emission, lights with a size.

pub mod back_faces;
pub mod emission_rays;
pub mod glass_shadows;
pub mod history;
pub mod passing;
pub mod sized_lights;
pub mod thin_walls;
