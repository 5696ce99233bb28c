//! What a command would make, told without loading the scene; and what an output file holds already.

use std::collections::HashMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use crate::balance::HALF_PILOT;
use crate::film::exr_file::{self, Header, HeaderValue};
use crate::render::saved::{self, FORMAT, Saved};
use crate::render::{Fingerprint, NOISE_PATHS, Part, RenderSettings, RenderStats, StopReason, fresh_tiles};
use crate::scene::import::{EnvironmentFile, SceneFiles, Survey};
use crate::{Error, Result};

use super::RenderArgs;

/// The contents that a command names, opened once.
#[derive(Debug)]
pub struct Inputs {
    /// The scene's files.
    pub scene: Survey,
    /// Of the environment: what tells it from others, and its bytes in memory.
    pub environment: (String, u64),
    /// What opening, hashing and measuring took.
    pub read_seconds: f64,
    /// The files themselves, until a scene is made of them.
    files: Mutex<Option<Files>>,
}

/// The files of a scene and of its environment.
#[derive(Debug)]
pub struct Files {
    pub scene: SceneFiles,
    pub environment: Option<EnvironmentFile>,
}

impl Inputs {
    /// Reads and hashes them.
    ///
    /// # Errors
    /// As [`SceneFiles::open`] and [`EnvironmentFile::open`].
    pub fn read(args: &RenderArgs) -> Result<Self> {
        let start = Instant::now();
        let environment_file = args.env.as_deref().map(EnvironmentFile::open).transpose()?;
        let environment = match &environment_file {
            Some(file) => {
                let name = format!("{} turned {} times {}", file.hash(), args.env_rotate, args.env_strength);
                (name, file.memory_bytes())
            }
            None if args.no_env => ("none".into(), 0),
            None => ("the scene's own".into(), 0),
        };
        let scene_files = SceneFiles::open(&args.scene)?;
        let scene = scene_files.survey();
        let files = Mutex::new(Some(Files { scene: scene_files, environment: environment_file }));
        Ok(Self { scene, environment, read_seconds: start.elapsed().as_secs_f64(), files })
    }

    /// Hands the files over. Opens them again when an earlier job of a batch had them and failed.
    ///
    /// # Errors
    /// As [`Inputs::read`]; [`Error::Data`] if they are others by now.
    pub fn take(&self, args: &RenderArgs) -> Result<Files> {
        let take = |inputs: &Self| inputs.files.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(files) = take(self) {
            return Ok(files);
        }
        let again = Self::read(args)?;
        take(&again)
            .filter(|_| (&again.scene.hash, &again.environment.0) == (&self.scene.hash, &self.environment.0))
            .ok_or_else(|| {
                Error::Data(format!(
                    "{}: has changed while it was waited for; run the command again",
                    args.scene.display()
                ))
            })
    }

    /// Tells commands apart that make different pictures, by contents and flags. Parts of a picture are alike.
    pub fn request(&self, args: &RenderArgs) -> String {
        let a = args;
        let flags = format!(
            "{:?} {:?} {:?} {:?} {} {:?} {:?} {} {:?} {:?} {:?} {}",
            a.camera,
            a.size,
            a.crop,
            a.integrator,
            a.max_depth,
            a.balance,
            a.filter,
            a.seed,
            a.rays,
            a.aov_names(),
            if a.balance.method().needs_goal() { a.spp } else { None },
            a.pilot.unwrap_or(HALF_PILOT),
        );
        let all = [env!("CARGO_PKG_VERSION"), &self.scene.hash, &self.environment.0, &flags].join("\n");
        blake3::hash(all.as_bytes()).to_hex().to_string()
    }
}

/// What an output file says of itself.
#[derive(Debug, Clone)]
pub struct Earlier {
    attributes: HashMap<String, HeaderValue>,
}

impl Earlier {
    /// Reads the header of a picture of ours; `None` if there is no file.
    ///
    /// # Errors
    /// As [`exr_file::read_header`]; [`Error::Data`] for pictures of others and of newer versions.
    pub fn read(path: &Path) -> Result<Option<Self>> {
        let header = match exr_file::read_header(path) {
            Err(Error::Missing(_)) => return Ok(None),
            other => other?,
        };
        let earlier = Self { attributes: header.into_iter().map(|(name, value)| (name.into(), value)).collect() };
        let refused = |why: String| Err(Error::Data(format!("{}: {why}", path.display())));
        match earlier.number("bismar.format") {
            None => refused("is no picture that bismar can go on from".into()),
            Some(format) if format > f64::from(FORMAT) => {
                refused(format!("is from a newer bismar (format {format}, this one knows {FORMAT}): use that version"))
            }
            Some(_) => Ok(Some(earlier)),
        }
    }

    fn number(&self, name: &str) -> Option<f64> {
        match self.attributes.get(name) {
            Some(HeaderValue::Number(x)) => Some(*x),
            _ => None,
        }
    }

    /// A text attribute.
    pub fn text(&self, name: &str) -> Option<&str> {
        match self.attributes.get(name) {
            Some(HeaderValue::Text(text)) => Some(text),
            _ => None,
        }
    }

    fn json<T: serde::de::DeserializeOwned>(&self, name: &str) -> Option<T> {
        serde_json::from_str(self.text(name)?).ok()
    }

    /// What the picture's bits depend on.
    pub fn fingerprint(&self) -> Option<Fingerprint> {
        self.json("bismar.fingerprint")
    }

    /// Settings that it was made with.
    pub fn settings(&self) -> Option<RenderSettings> {
        self.json("bismar.settings")
    }

    /// Counts and times of all sessions.
    pub fn stats(&self) -> Option<RenderStats> {
        self.json("bismar.sessions")
    }

    /// Fewest paths of a pixel.
    pub fn paths(&self) -> u32 {
        let samples: Option<serde_json::Value> = self.json("bismar.samples");
        samples.and_then(|s| s["pixel_min"].as_u64()).map_or(0, |n| n as u32)
    }

    /// Was it made by a command with this request, for this part?
    pub fn answers(&self, request: &str, part: Option<Part>) -> bool {
        self.text("bismar.request") == Some(request) && self.settings().is_some_and(|s| s.part == part)
    }

    /// Why it ended.
    pub fn stop(&self) -> Option<StopReason> {
        serde_json::from_value(self.text("bismar.stop")?.into()).ok()
    }

    /// Can it be gone on from when it is done?
    pub fn keeps_statistics(&self) -> bool {
        self.number("bismar.keeps") == Some(1.0)
    }

    /// Does it fulfil one of these stop rules already?
    pub fn is_done(&self, spp: Option<u32>, time: Option<f64>, noise: Option<f64>) -> bool {
        if self.stop().is_none_or(|stop| stop == StopReason::Interrupted) {
            return false;
        }
        let paths = self.paths();
        let seconds = match (self.stop(), self.settings()) {
            // It may end before its time, when no path fits any more.
            (Some(StopReason::Time), Some(settings)) => settings.time.unwrap_or(0.0),
            _ => self.stats().map_or(0.0, |s| s.seconds),
        };
        let now = self.number("bismar.noise").unwrap_or(f64::INFINITY);
        spp.is_some_and(|goal| paths >= goal)
            || time.is_some_and(|limit| seconds >= limit)
            || noise.is_some_and(|goal| now <= goal && paths >= NOISE_PATHS)
    }

    /// What a render of these settings goes on from.
    ///
    /// # Errors
    /// [`Error::Data`], with what differs, when it is another render, or carries no statistics.
    pub fn saved(&self, path: &Path, ours: &Fingerprint, settings: &RenderSettings) -> Result<Saved> {
        let refused = |why: String| Error::Data(format!("--resume: {}: {why}", path.display()));
        let else_ = "; without --resume it is rendered anew";
        match self.fingerprint() {
            Some(theirs) if theirs == *ours => {}
            Some(theirs) => {
                return Err(refused(format!("holds another render: different {}{else_}", ours.differences(&theirs))));
            }
            None => return Err(refused(format!("does not say what it was made of{else_}"))),
        }
        let part = |part: Option<Part>| part.map_or("the whole".into(), |p| format!("part {p}"));
        let theirs = self.settings().and_then(|s| s.part);
        if theirs != settings.part {
            return Err(refused(format!("holds {}, not {}", part(theirs), part(settings.part))));
        }
        let Some(bytes) = exr_file::read_statistics(path)? else {
            return Err(refused(format!(
                "carries no statistics to go on from, as it was rendered without --checkpoint{else_}"
            )));
        };
        let tiles = match self.number("bismar.format") {
            Some(2.0) => saved::unpack_2(&bytes, settings.columns()),
            _ => saved::unpack(&bytes),
        };
        let tiles = tiles.filter(|tiles| saved::fits(tiles, &fresh_tiles(settings)));
        match (tiles, self.stats()) {
            (Some(tiles), Some(stats)) => Ok(Saved { tiles, stats }),
            _ => Err(refused(format!("its statistics are not those of such a render{else_}"))),
        }
    }
}

/// Header attributes that make a picture one to go on from.
pub fn attributes(request: &str, fingerprint: &Fingerprint, stats: &RenderStats, keeps: bool) -> Result<Header> {
    let json =
        |value: serde_json::Result<String>| value.map(HeaderValue::Text).map_err(|e| Error::Bug(format!("JSON: {e}")));
    Ok(vec![
        ("bismar.format".into(), HeaderValue::Number(FORMAT.into())),
        ("bismar.request".into(), HeaderValue::Text(request.into())),
        ("bismar.fingerprint".into(), json(serde_json::to_string(fingerprint))?),
        ("bismar.sessions".into(), json(serde_json::to_string(stats))?),
        ("bismar.keeps".into(), HeaderValue::Number(if keeps { 1.0 } else { 0.0 })),
    ])
}
