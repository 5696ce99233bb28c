//! Supported extensions, and the effect of ignoring the others.

use crate::error::{Error, Result};

/// Points that are no points.
pub(crate) const SPLATS: &str = "KHR_gaussian_splatting";

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Support {
    Full,
    /// Has no effect on the picture, or has an exact fallback in core glTF.
    NoEffect,
    /// Ignored, with the reason.
    Ignored(&'static str),
}

pub fn support(name: &str) -> Support {
    use Support::*;
    match name {
        "KHR_lights_punctual"
        | "KHR_materials_anisotropy"
        | "KHR_materials_clearcoat"
        | "KHR_materials_diffuse_transmission"
        | "KHR_materials_dispersion"
        | "KHR_materials_emissive_strength"
        | "KHR_materials_ior"
        | "KHR_materials_iridescence"
        | "KHR_materials_pbrSpecularGlossiness"
        | "KHR_materials_sheen"
        | "KHR_materials_specular"
        | "KHR_materials_transmission"
        | "KHR_materials_unlit"
        | "KHR_materials_variants"
        | "KHR_materials_volume"
        | "KHR_mesh_quantization"
        | "KHR_node_visibility"
        | "KHR_texture_transform"
        | "KHR_draco_mesh_compression"
        | "KHR_meshopt_compression"
        | "KHR_texture_basisu"
        | "EXT_mesh_gpu_instancing"
        | "EXT_mesh_primitive_restart"
        | "EXT_meshopt_compression"
        | "EXT_texture_webp" => Full,
        "AGI_articulations"
        | "CESIUM_primitive_outline"
        | "EXT_instance_features"
        | "EXT_mesh_features"
        | "EXT_mesh_manifold"
        | "EXT_mesh_primitive_edge_visibility"
        | "EXT_structural_metadata"
        | "GRIFFEL_bim_data"
        | "KHR_animation_pointer"
        | "KHR_implicit_shapes"
        | "KHR_interactivity"
        | "KHR_node_hoverability"
        | "KHR_node_selectability"
        | "KHR_physics_rigid_bodies"
        | "KHR_xmp"
        | "KHR_xmp_json_ld"
        | "MSFT_lod" => NoEffect,
        "MSFT_texture_dds" => Ignored("DDS is not read"),
        // Those of vendors.
        _ if name.to_ascii_lowercase().contains("metadata") => NoEffect,
        SPLATS => Ignored("splats are not shown"),
        "EXT_lights_image_based" => Ignored("the file's own environment is not read: give one of your own"),
        _ => Ignored("not known to this renderer"),
    }
}

/// Checks the required extensions.
/// Errors: Names every required extension that is not supported.
pub(crate) fn check_required(required: &[String]) -> Result<()> {
    let is_ignored = |name: &&String| matches!(support(name), Support::Ignored(_));
    let refused: Vec<_> = required.iter().filter(is_ignored).cloned().collect();
    if refused.is_empty() {
        return Ok(());
    }
    Err(Error::Data(format!(
        "extensionsRequired: the file cannot be shown without {}, which this renderer does not have; export it without",
        refused.join(", ")
    )))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;

    use super::*;

    #[test]
    fn the_table_of_the_documentation_is_this_one() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let table = include_str!("../../../../../../docs/gltf.md");
        let mut listed = BTreeSet::new();
        for row in table.split("## Extensions").nth(1).unwrap().lines().filter(|line| line.starts_with("| `")) {
            let [_, name, state, tests, _] = row.split('|').map(str::trim).collect::<Vec<_>>()[..] else {
                panic!("not a row: {row}")
            };
            let name = name.trim_matches('`');
            let expected = match support(name) {
                Support::Full => "as it asks",
                Support::NoEffect => "no effect",
                Support::Ignored(_) => "left out",
            };
            assert_eq!(state, expected, "{name}");
            for test in tests.split(',').map(|test| test.trim().trim_matches('`')).filter(|test| !test.is_empty()) {
                assert!(root.join(test).is_file(), "{name}: there is no {test}");
            }
            assert!(listed.insert(name.to_owned()), "{name} twice");
        }
        // The names in the function above, as they are written there.
        let source = include_str!("extensions.rs").split("#[cfg(test)]").next().unwrap();
        let names =
            source.split('"').filter(|text| text.starts_with(|c: char| c.is_ascii_uppercase()) && text.contains('_'));
        assert_eq!(listed, names.map(str::to_owned).collect());
    }
}
