//! Material extensions that add BSDF lobes.

use glam::Vec3;

use super::json::Json;
use super::texture_info::{TextureInfo, TextureInfos};
use crate::error::Result;
use crate::scene::{Material, TextureSlot};

/// Range of most factors.
pub const UNIT: [f32; 2] = [0.0, 1.0];

/// Reads factors, and notes which are out of range.
#[derive(Default)]
pub struct Factors {
    /// Paths of those that were clamped.
    pub clamped: Vec<String>,
}

impl Factors {
    /// A number, clamped to a range.
    pub fn number(&mut self, json: &Json, key: &str, [low, high]: [f32; 2], default: f32) -> Result<f32> {
        let x = json.number(key)?.map_or(default, |x| x as f32);
        if !(low..=high).contains(&x) {
            self.clamped.push(json.path(key));
        }
        Ok(x.clamp(low, high))
    }

    /// Numbers, clamped to [0, 1].
    pub fn color<const N: usize>(&mut self, json: &Json, key: &str, default: [f32; N]) -> Result<[f32; N]> {
        let color = json.vector::<N>(key)?.map_or(default, |color| color.map(|x| x as f32));
        if !color.iter().all(|x| (0.0..=1.0).contains(x)) {
            self.clamped.push(json.path(key));
        }
        Ok(color.map(|x| x.clamp(0.0, 1.0)))
    }
}

/// Reads the material's extensions into `plain` and `textures`.
/// Errors: Members of the wrong type, texture indices out of range.
pub fn parse(json: &Json, plain: &mut Material, textures: &mut TextureInfos, factors: &mut Factors) -> Result<()> {
    let texture = TextureInfo::parse;
    if let Some(json) = json.extension("KHR_materials_transmission")? {
        plain.transmission = factors.number(&json, "transmissionFactor", UNIT, 0.0)?;
        textures[TextureSlot::Transmission as usize] = texture(&json, "transmissionTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_volume")? {
        plain.bounds_medium = factors.number(&json, "thicknessFactor", [0.0, f32::INFINITY], 0.0)? > 0.0;
        // The thickness texture is only checked: path lengths inside the medium are traced.
        texture(&json, "thicknessTexture")?;
        let range = [f32::MIN_POSITIVE, f32::INFINITY];
        let distance = factors.number(&json, "attenuationDistance", range, f32::INFINITY)?;
        let distance = if distance < f32::MAX { distance } else { f32::INFINITY };
        let color = factors.color(&json, "attenuationColor", [1.0; 3])?;
        // A colour of 0 would need infinite absorption; 1e-20 is black in practice.
        plain.absorption = Vec3::from(color.map(|x| -x.max(1e-20).ln() / distance)).min(Vec3::splat(f32::MAX));
    }
    if let Some(json) = json.extension("KHR_materials_diffuse_transmission")? {
        plain.diffuse_transmission = factors.number(&json, "diffuseTransmissionFactor", UNIT, 0.0)?;
        plain.diffuse_transmission_color = factors.color(&json, "diffuseTransmissionColorFactor", [1.0; 3])?.into();
        textures[TextureSlot::DiffuseTransmission as usize] = texture(&json, "diffuseTransmissionTexture")?;
        textures[TextureSlot::DiffuseTransmissionColor as usize] = texture(&json, "diffuseTransmissionColorTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_sheen")? {
        plain.sheen_color = factors.color(&json, "sheenColorFactor", [0.0; 3])?.into();
        plain.sheen_roughness = factors.number(&json, "sheenRoughnessFactor", UNIT, 0.0)?;
        textures[TextureSlot::SheenColor as usize] = texture(&json, "sheenColorTexture")?;
        textures[TextureSlot::SheenRoughness as usize] = texture(&json, "sheenRoughnessTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_clearcoat")? {
        plain.clearcoat = factors.number(&json, "clearcoatFactor", UNIT, 0.0)?;
        plain.clearcoat_roughness = factors.number(&json, "clearcoatRoughnessFactor", UNIT, 0.0)?;
        textures[TextureSlot::Clearcoat as usize] = texture(&json, "clearcoatTexture")?;
        textures[TextureSlot::ClearcoatRoughness as usize] = texture(&json, "clearcoatRoughnessTexture")?;
        textures[TextureSlot::ClearcoatNormal as usize] = texture(&json, "clearcoatNormalTexture")?;
        if let Some(map) = json.get("clearcoatNormalTexture")? {
            plain.clearcoat_normal_scale = map.number("scale")?.unwrap_or(1.0) as f32;
        }
    }
    if let Some(json) = json.extension("KHR_materials_anisotropy")? {
        plain.anisotropy = factors.number(&json, "anisotropyStrength", UNIT, 0.0)?;
        plain.anisotropy_rotation = json.number("anisotropyRotation")?.unwrap_or(0.0) as f32;
        textures[TextureSlot::Anisotropy as usize] = texture(&json, "anisotropyTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_iridescence")? {
        plain.iridescence = factors.number(&json, "iridescenceFactor", UNIT, 0.0)?;
        plain.iridescence_ior = factors.number(&json, "iridescenceIor", [1.0, f32::from(u8::MAX)], 1.3)?;
        let thickness = [0.0, f32::from(u16::MAX)];
        plain.iridescence_thickness = [
            factors.number(&json, "iridescenceThicknessMinimum", thickness, 100.0)?,
            factors.number(&json, "iridescenceThicknessMaximum", thickness, 400.0)?,
        ];
        textures[TextureSlot::Iridescence as usize] = texture(&json, "iridescenceTexture")?;
        textures[TextureSlot::IridescenceThickness as usize] = texture(&json, "iridescenceThicknessTexture")?;
    }
    if let Some(json) = json.extension("KHR_materials_dispersion")? {
        plain.dispersion = factors.number(&json, "dispersion", [0.0, f32::from(u8::MAX)], 0.0)?;
    }
    if let Some(json) = json.extension("KHR_materials_pbrSpecularGlossiness")? {
        plain.specular_glossiness = Some(factors.color(&json, "specularFactor", [1.0; 3])?.into());
        plain.base_color = factors.color(&json, "diffuseFactor", [1.0; 4])?.into();
        plain.roughness = 1.0 - factors.number(&json, "glossinessFactor", UNIT, 1.0)?;
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
