//! Values of the flags of a request, with their help.

use std::collections::BTreeMap;

use bismar_scene::Named;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::film::Aov;
use crate::integrator::Reuse;
use crate::render::settings::techniques::Row;
use crate::render::{Balance, Choice, PerTechnique, Technique};
use crate::scene::{Environment, MAX_RADIUS};

type Parsed<T> = std::result::Result<T, String>;

pub fn finite(text: &str) -> Parsed<f32> {
    text.parse().ok().filter(|x: &f32| x.is_finite()).ok_or("not a number".into())
}

pub(crate) fn not_negative(text: &str) -> Parsed<f32> {
    finite(text).ok().filter(|x| *x >= 0.0).ok_or("not a number of 0 or more".into())
}

/// Parser of `--balance`, with all methods as possible values.
pub fn balance() -> impl TypedValueParser<Value = Balance> {
    let names = Balance::all().iter().map(|b| PossibleValue::new(b.name()).help(b.method().about()));
    PossibleValuesParser::new(names).map(|name| Balance::named(&name).expect("one of them"))
}

/// The parser of a flag with such values.
pub fn value_of<T: Named>() -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(possible::<T>().map(|(_, value)| value)).try_map(named)
}

/// Values, as those of a flag with their help.
fn possible<T: Named>() -> impl Iterator<Item = (T, PossibleValue)> {
    let value =
        |name: &'static str, help: &'static str| PossibleValue::new(name).help(help.trim().trim_end_matches('.'));
    T::VALUES.iter().map(move |(variant, name, help)| (*variant, value(name, help)))
}

/// The value of a name.
fn named<T: Named>(name: String) -> std::result::Result<T, &'static str> {
    T::VALUES.iter().find(|value| value.1 == name).map(|value| value.0).ok_or("unknown value")
}

/// The choices that are asked for.
#[derive(Debug, Clone, Default)]
pub struct TechniqueOptions {
    /// `None`: as usual beside the other options.
    pub choices: PerTechnique<Option<Choice>>,
    /// Sizes of `--path-reuse`.
    pub reuse_sizes: Option<Reuse>,
}

/// Parses `--path-reuse`: a choice, or sizes, which turn it on.
fn path_reuse(text: &str) -> Parsed<(Choice, Option<Reuse>)> {
    match Choice::ALL.into_iter().find(|choice| choice.name() == text) {
        Some(choice) => Ok((choice, None)),
        None => {
            text.parse().map(|sizes| (Choice::On, Some(sizes))).map_err(|why: String| format!("off, on, auto, {why}"))
        }
    }
}

impl TechniqueOptions {
    fn flag(technique: Technique) -> Arg {
        let Row { flag, about, even, is_switch, .. } = *technique.row();
        let names = possible().map(|(choice, value)| match choice {
            // Batch files have true and false.
            Choice::Off => value.alias("false"),
            Choice::On => value.alias("true"),
            Choice::Auto => value,
        });
        let parser = PossibleValuesParser::new(names).map(|name| match name.as_str() {
            "off" | "false" => Choice::Off,
            "on" | "true" => Choice::On,
            _ => Choice::Auto,
        });
        let alone = if is_switch { format!("; --{flag} alone: on") } else { String::new() };
        let help = format!("{about} [default: auto with --balance progressive, else off{alone}]");
        let arg = Arg::new(flag).long(flag).help(help).help_heading("Sampling");
        let arg = match technique {
            Technique::PathReuse => arg.value_name("WHEN|N[:M]").value_parser(path_reuse),
            _ => arg.value_name("WHEN").value_parser(parser),
        };
        let arg = if even == Choice::Off { arg.default_value_if("preset", "thumbnail", "off") } else { arg };
        match is_switch {
            true => arg.num_args(0..=1).require_equals(true).default_missing_value(Choice::On.name()),
            false => arg,
        }
    }
}

impl Args for TechniqueOptions {
    fn augment_args(command: Command) -> Command {
        command.args(Technique::ALL.map(Self::flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for TechniqueOptions {
    fn from_arg_matches(matches: &ArgMatches) -> std::result::Result<Self, clap::Error> {
        let flag = Technique::PathReuse.row().flag;
        let (of_path_reuse, reuse_sizes) =
            matches.get_one(flag).copied().map_or((None, None), |(choice, sizes)| (Some(choice), sizes));
        let choices = PerTechnique::new(|technique| match technique {
            Technique::PathReuse => of_path_reuse,
            _ => matches.get_one(technique.row().flag).copied(),
        });
        Ok(Self { choices, reuse_sizes })
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> std::result::Result<(), clap::Error> {
        Self::from_arg_matches(matches).map(|flags| *self = flags)
    }
}

impl Serialize for TechniqueOptions {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_map(self.choices.iter().map(|(technique, choice)| {
            let sizes = self.reuse_sizes.filter(|_| technique == Technique::PathReuse).map(|sizes| sizes.to_string());
            (technique.row().flag, sizes.or(choice.map(|choice| choice.name().to_owned())))
        }))
    }
}

impl<'de> Deserialize<'de> for TechniqueOptions {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let given = BTreeMap::<String, serde_json::Value>::deserialize(deserializer)?;
        let mut options = Self::default();
        for technique in Technique::ALL {
            let Some(text) = given.get(technique.row().flag).and_then(|value| value.as_str()) else { continue };
            let (choice, sizes) = path_reuse(text).map_err(D::Error::custom)?;
            options.choices[technique] = Some(choice);
            options.reuse_sizes = options.reuse_sizes.or(sizes);
        }
        Ok(options)
    }
}

bismar_scene::named_variants! {
    /// Value of `--preset`: other defaults of some flags. The values are conditional defaults of the request's.
    pub enum Preset {
        /// --size 512x512 --spp 16 --aov none --adaptive off --guiding off --path-reuse off
        Thumbnail = "thumbnail",
        /// --size 1024x1024 --spp 256 --ground shadow
        Product = "product",
        /// --size 1920x1080 --spp 1024 --checkpoint 60
        Final = "final",
    }
}

impl Preset {
    /// The flags that it stands for.
    pub fn flags(self) -> &'static str {
        Self::VALUES[self as usize].2.trim()
    }

    /// Whether it denoises where Open Image Denoise is installed.
    pub(crate) fn denoises(self) -> bool {
        self != Self::Final
    }
}

/// Parser of `--preset`, with what each sets as its help.
pub fn preset() -> impl TypedValueParser<Value = Preset> {
    let help = |preset: Preset| match preset.denoises() {
        true => format!("{} --denoise oidn (where it is installed; not in batch files)", preset.flags()),
        false => preset.flags().to_owned(),
    };
    let names = Preset::ALL.map(|preset| PossibleValue::new(preset.name()).help(help(preset)));
    PossibleValuesParser::new(names).try_map(named)
}

pub fn blades(text: &str) -> Parsed<u32> {
    text.parse().ok().filter(|n| *n == 0 || (3..=32).contains(n)).ok_or("not a number from 3 to 32, nor 0".into())
}

pub fn share(text: &str) -> Parsed<f64> {
    text.parse().ok().filter(|x: &f64| *x > 0.0 && *x < 1.0).ok_or("not a number above 0 and below 1".into())
}

/// Parser of `--light-radius`.
pub(crate) fn light_radius(text: &str) -> Parsed<f32> {
    not_negative(text).ok().filter(|x| *x <= MAX_RADIUS).ok_or(format!("not metres from 0 to {MAX_RADIUS:e}"))
}

/// Parser of `--env-strength`.
pub(crate) fn env_strength(text: &str) -> Parsed<f32> {
    let most = Environment::MAX_STRENGTH;
    not_negative(text).ok().filter(|x| *x <= most).ok_or(format!("not a number from 0 to {most:e}"))
}

/// Parser of `--sun-angle`.
pub(crate) fn sun_angle(text: &str) -> Parsed<f32> {
    not_negative(text).ok().filter(|x| *x <= 180.0).ok_or("not degrees from 0 to 180".into())
}

bismar_scene::named_variants! {
    /// A switch that is on by default.
    pub enum OnOff {
        /// On.
        On = "on",
        /// Off.
        Off = "off",
    }
}

bismar_scene::named_variants! {
    /// Unit of the file's punctual lights.
    pub enum LightUnit {
        /// Candela and lux, as KHR_lights_punctual defines.
        Lumen = "lumen",
        /// W/sr and W/m^2, multiplied by 683 lm/W as Blender's exporter does.
        Watt = "watt",
    }
}

impl LightUnit {
    /// Factor on intensities.
    pub fn factor(self) -> f32 {
        match self {
            Self::Lumen => 1.0,
            Self::Watt => 1.0 / 683.0,
        }
    }
}

/// `x0,y0,x1,y1`: a window in pixels from the top left; x1 and y1 are exclusive.
pub fn crop(text: &str) -> Parsed<[u32; 4]> {
    let numbers = text.split(',').map(|n| n.trim().parse().ok()).collect::<Option<Vec<u32>>>();
    let window = numbers.and_then(|n| <[u32; 4]>::try_from(n).ok());
    match window {
        Some(window @ [x0, y0, x1, y1]) if x0 < x1 && y0 < y1 => Ok(window),
        Some(_) => Err("the window is empty: x1 must be above x0, and y1 above y0".into()),
        None => Err("not x0,y0,x1,y1 in pixels".into()),
    }
}

/// AOVs separated by commas, or `all`, or `none`.
pub(crate) fn aov_list(text: &str) -> Parsed<Vec<Aov>> {
    let one = |name: &str| {
        let name = name.trim();
        Aov::ALL.into_iter().find(|aov| aov.name() == name).ok_or_else(|| {
            let names = Aov::ALL.map(Aov::name).join(", ");
            format!("there is no AOV '{name}'; there are {names}, all and none")
        })
    };
    match text {
        "none" => Ok(Vec::new()),
        "all" => Ok(Aov::ALL.to_vec()),
        list => list.split(',').map(one).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_windows_and_lists_are_read_or_refused() {
        assert_eq!(crop("0,1,2,3"), Ok([0, 1, 2, 3]));
        for bad in ["", "1,2,3", "2,0,1,5", "0,0,0,1", "0,0,1,1,1", "-1,0,1,1"] {
            assert!(crop(bad).is_err(), "{bad}");
        }
        assert_eq!(aov_list("depth, normal"), Ok(vec![Aov::Depth, Aov::Normal]));
        assert_eq!(aov_list("all").map(|list| list.len()), Ok(19));
        assert_eq!(aov_list("variance,samples,balance"), Ok(Aov::DEFAULT.to_vec()));
        assert!(aov_list("depth,,normal").is_err());
    }
}
