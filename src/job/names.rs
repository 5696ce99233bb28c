//! Names behind the IDs and Cryptomatte hashes of objects and materials.

use crate::Result;
use crate::film::aov::{MATERIALS, OBJECTS};
use crate::film::exr_file::Header;
use crate::film::{Aov, cryptomatte};
use crate::render::checkpoint;
use crate::scene::Scene;

/// Header attributes with the names that these AOVs refer to.
pub fn names(scene: &Scene, aovs: &[Aov]) -> Result<Header> {
    let objects = || scene.instances.iter().map(|instance| instance.name.as_str());
    let materials = || scene.materials.iter().map(|material| material.name.as_str());
    let mut header = Header::new();
    for aov in aovs {
        match aov {
            Aov::Object => {
                header.push(("bismar.objects".into(), checkpoint::json(&objects().collect::<Vec<_>>())?));
                let categories: Vec<_> = scene.instances.iter().map(|instance| instance.category.as_deref()).collect();
                if categories.iter().any(Option::is_some) {
                    header.push(("bismar.categories".into(), checkpoint::json(&categories)?));
                }
            }
            Aov::Material => {
                header.push(("bismar.materials".into(), checkpoint::json(&materials().collect::<Vec<_>>())?))
            }
            Aov::CryptoObject => header.extend(cryptomatte::header(OBJECTS, objects())),
            Aov::CryptoMaterial => header.extend(cryptomatte::header(MATERIALS, materials())),
            _ => {}
        }
    }
    Ok(header)
}
