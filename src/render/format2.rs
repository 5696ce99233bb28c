//! Files of format 2, which bismar wrote before there was a [`Record`]: what their headers say, as one.

use std::collections::BTreeMap;

use serde::de::DeserializeOwned;
use serde_json::Value;

use super::Identity;
use super::checkpoint::{Host, Record, number, text};
use super::identity::{Asked, name};
use crate::balance::DEFAULT_PILOT_FRACTION;
use crate::film::Background;
use crate::film::exr_file::Header;
use crate::rays::Backend;

/// What a header of format 2 says; `None` if it does not say enough.
pub fn record(header: &Header) -> Option<Record> {
    let fingerprint: BTreeMap<String, String> = json(header, "bismar.fingerprint")?;
    let of = |name: &str| fingerprint.get(name).cloned();
    let samples: Value = json(header, "bismar.samples").unwrap_or_default();
    let backend: Value = json(header, "bismar.backend").unwrap_or_default();
    let rays: Backend = serde_json::from_value(of("rays")?.into()).ok()?;
    Some(Record {
        identity: Identity {
            version: of("version")?,
            scene: of("scene")?,
            environment: of("environment")?,
            rays,
            settings: json(header, "bismar.settings")?,
        },
        request: text(header, "bismar.request")?.into(),
        aovs: text(header, "bismar.aov").unwrap_or_default().into(),
        stats: json(header, "bismar.sessions")?,
        stop: serde_json::from_value(text(header, "bismar.stop")?.into()).ok()?,
        noise: number(header, "bismar.noise").filter(|noise| noise.is_finite()),
        worst_noise: None,
        paths: samples["pixel_min"].as_u64().map_or(0, |n| n as u32),
        keeps: number(header, "bismar.keeps") == Some(1.0),
        host: Host {
            version: backend["version"].as_str().unwrap_or("?").into(),
            isa: backend["isa"].as_str().unwrap_or("?").into(),
        },
        maker: None,
        seeds: Vec::new(),
        half: false,
        background: Background::Black,
    })
}

fn json<T: DeserializeOwned>(header: &Header, name: &str) -> Option<T> {
    serde_json::from_str(text(header, name)?).ok()
}

/// What [`Identity::request`] was.
pub fn request(identity: &Identity, asked: &Asked) -> String {
    let s = &identity.settings;
    let size = asked.size.map_or("None".into(), |[w, h]| format!("Some(Size({w}, {h}))"));
    let crop = s.crop.map_or("None".into(), |c| format!("Some(Crop({c:?}))"));
    let [integrator, balance, filter, rays] =
        [name(&s.integrator), name(&s.balance), name(&s.filter), name(&identity.rays)].map(|name| capitals(&name));
    let flags = format!(
        "{:?} {size} {crop} {integrator} {} {balance} {filter} {} {rays} {:?} {:?} {}",
        asked.camera,
        s.max_depth,
        s.seed,
        asked.aovs,
        if s.balance.method().needs_goal() { s.spp } else { None },
        s.pilot.unwrap_or(DEFAULT_PILOT_FRACTION),
    );
    let all = [&identity.version, &identity.scene, &identity.environment, &flags].map(String::as_str).join("\n");
    blake3::hash(all.as_bytes()).to_hex().to_string()
}

/// `SecondOrder` for `second-order`: the names that were in the program.
fn capitals(name: &str) -> String {
    let word = |word: &str| {
        let (first, rest) = word.split_at(word.len().min(1));
        first.to_uppercase() + rest
    };
    name.split('-').map(word).collect()
}
