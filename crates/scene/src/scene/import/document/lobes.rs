//! Material extensions that add BSDF lobes.

use glam::Vec3;
use gltf::json::extensions::material::Material as Extensions;

use super::json::Json;
use super::texture_info::{TextureInfo, TextureInfos};
use crate::error::Result;
use crate::scene::{Material, TextureSlot};

/// Reads the material's extensions into `plain` and `textures`; adds the paths of factors out of range to `clamped`.
///
/// # Errors
/// Members of the wrong type, texture indices out of range.
pub fn parse(
    json: &Json,
    extensions: &Extensions,
    plain: &mut Material,
    textures: &mut TextureInfos,
    clamped: &mut Vec<String>,
) -> Result<()> {
    let mut within = |json: &Json, key: &str, [low, high]: [f32; 2], x: f32| {
        if !(low..=high).contains(&x) {
            clamped.push(json.path(key));
        }
        x.clamp(low, high)
    };
    let texture = TextureInfo::parse;
    if let (Some(from), Some(json)) = (&extensions.transmission, json.extension("KHR_materials_transmission")?) {
        plain.transmission = within(&json, "transmissionFactor", [0.0, 1.0], from.transmission_factor.0);
        textures[TextureSlot::Transmission as usize] = texture(&json, "transmissionTexture")?;
    }
    if let (Some(from), Some(json)) = (&extensions.volume, json.extension("KHR_materials_volume")?) {
        plain.bounds_medium = within(&json, "thicknessFactor", [0.0, f32::INFINITY], from.thickness_factor.0) > 0.0;
        // The thickness texture is only checked: path lengths inside the medium are traced.
        texture(&json, "thicknessTexture")?;
        let distance =
            within(&json, "attenuationDistance", [f32::MIN_POSITIVE, f32::INFINITY], from.attenuation_distance.0);
        let color = from.attenuation_color.0.map(|x| within(&json, "attenuationColor", [0.0, 1.0], x));
        // A colour of 0 would need infinite absorption; 1e-20 is black in practice.
        plain.absorption = Vec3::from(color.map(|x| -x.max(1e-20).ln() / distance)).min(Vec3::splat(f32::MAX));
    }
    let unit = [0.0, 1.0];
    if let Some(json) = json.extension("KHR_materials_diffuse_transmission")? {
        let factor = json.number("diffuseTransmissionFactor")?.unwrap_or(0.0);
        plain.diffuse_transmission = within(&json, "diffuseTransmissionFactor", unit, factor as f32);
        let color = json.vector::<3>("diffuseTransmissionColorFactor")?.unwrap_or([1.0; 3]);
        let color = color.map(|x| within(&json, "diffuseTransmissionColorFactor", unit, x as f32));
        plain.diffuse_transmission_color = color.into();
        textures[TextureSlot::DiffuseTransmission as usize] = texture(&json, "diffuseTransmissionTexture")?;
        textures[TextureSlot::DiffuseTransmissionColor as usize] = texture(&json, "diffuseTransmissionColorTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_sheen")? {
        let color = json.vector::<3>("sheenColorFactor")?.unwrap_or([0.0; 3]);
        plain.sheen_color = color.map(|x| within(&json, "sheenColorFactor", unit, x as f32)).into();
        let roughness = json.number("sheenRoughnessFactor")?.unwrap_or(0.0);
        plain.sheen_roughness = within(&json, "sheenRoughnessFactor", unit, roughness as f32);
        textures[TextureSlot::SheenColor as usize] = texture(&json, "sheenColorTexture")?;
        textures[TextureSlot::SheenRoughness as usize] = texture(&json, "sheenRoughnessTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_clearcoat")? {
        let mut factor =
            |key: &str| -> Result<f32> { Ok(within(&json, key, unit, json.number(key)?.unwrap_or(0.0) as f32)) };
        plain.clearcoat = factor("clearcoatFactor")?;
        plain.clearcoat_roughness = factor("clearcoatRoughnessFactor")?;
        textures[TextureSlot::Clearcoat as usize] = texture(&json, "clearcoatTexture")?;
        textures[TextureSlot::ClearcoatRoughness as usize] = texture(&json, "clearcoatRoughnessTexture")?;
        textures[TextureSlot::ClearcoatNormal as usize] = texture(&json, "clearcoatNormalTexture")?;
        if let Some(map) = json.get("clearcoatNormalTexture")? {
            plain.clearcoat_normal_scale = map.number("scale")?.unwrap_or(1.0) as f32;
        }
    }
    if let Some(json) = json.extension("KHR_materials_anisotropy")? {
        let strength = json.number("anisotropyStrength")?.unwrap_or(0.0) as f32;
        plain.anisotropy = within(&json, "anisotropyStrength", unit, strength);
        plain.anisotropy_rotation = json.number("anisotropyRotation")?.unwrap_or(0.0) as f32;
        textures[TextureSlot::Anisotropy as usize] = texture(&json, "anisotropyTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_iridescence")? {
        let mut number = |key: &str, range: [f32; 2], default: f32| -> Result<f32> {
            Ok(within(&json, key, range, json.number(key)?.map_or(default, |x| x as f32)))
        };
        plain.iridescence = number("iridescenceFactor", unit, 0.0)?;
        plain.iridescence_ior = number("iridescenceIor", [1.0, f32::from(u8::MAX)], 1.3)?;
        let thickness = [0.0, f32::from(u16::MAX)];
        plain.iridescence_thickness = [
            number("iridescenceThicknessMinimum", thickness, 100.0)?,
            number("iridescenceThicknessMaximum", thickness, 400.0)?,
        ];
        textures[TextureSlot::Iridescence as usize] = texture(&json, "iridescenceTexture")?;
        textures[TextureSlot::IridescenceThickness as usize] = texture(&json, "iridescenceThicknessTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_dispersion")? {
        let dispersion = json.number("dispersion")?.unwrap_or(0.0) as f32;
        plain.dispersion = within(&json, "dispersion", [0.0, f32::from(u8::MAX)], dispersion);
    }
    let name = "KHR_materials_pbrSpecularGlossiness";
    if let (Some(from), Some(json)) = (&extensions.pbr_specular_glossiness, json.extension(name)?) {
        let specular = from.specular_factor.0.map(|x| within(&json, "specularFactor", unit, x));
        plain.specular_glossiness = Some(specular.into());
        plain.base_color = from.diffuse_factor.0.map(|x| within(&json, "diffuseFactor", unit, x)).into();
        plain.roughness = 1.0 - within(&json, "glossinessFactor", unit, from.glossiness_factor.0);
        plain.metallic = 0.0;
        // Specular-glossiness excludes these metallic-roughness extensions.
        (plain.transmission, plain.diffuse_transmission) = (0.0, 0.0);
        (plain.anisotropy, plain.iridescence) = (0.0, 0.0);
        textures[TextureSlot::BaseColor as usize] = texture(&json, "diffuseTexture")?;
        textures[TextureSlot::SpecularGlossiness as usize] = texture(&json, "specularGlossinessTexture")?;
        textures[TextureSlot::MetallicRoughness as usize] = None;
    }
    Ok(())
}
