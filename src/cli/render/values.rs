//! Value parsers of the flags of `bismar render`.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, ArgMatches, Args, Command, FromArgMatches, ValueEnum};

use crate::cli::flag_values::FlagValue;
use crate::farm::array::{ArrayTask, array_task};
use crate::film::Aov;
use crate::integrator::Reuse;
use crate::render::settings::techniques::Row;
use crate::render::{Balance, Choice, Part, PerTechnique, Technique};
use crate::scene::{Environment, MAX_RADIUS};

type Parsed<T> = std::result::Result<T, String>;

pub fn finite(text: &str) -> Parsed<f32> {
    text.parse().ok().filter(|x: &f32| x.is_finite()).ok_or("not a number".into())
}

pub fn not_negative(text: &str) -> Parsed<f32> {
    finite(text).ok().filter(|x| *x >= 0.0).ok_or("not a number of 0 or more".into())
}

/// Parser of `--balance`, with all methods as possible values.
pub fn balance() -> impl TypedValueParser<Value = Balance> {
    let names = Balance::all().iter().map(|b| PossibleValue::new(b.name()).help(b.method().about()));
    PossibleValuesParser::new(names).map(|name| Balance::named(&name).expect("one of them"))
}

/// The flags of all techniques; `None` for those that are not given.
#[derive(Debug, Clone)]
pub struct TechniqueFlags {
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

impl TechniqueFlags {
    fn flag(technique: Technique) -> Arg {
        let Row { flag, about, unnamed, is_switch, .. } = *technique.row();
        let names = Choice::ALL.map(|choice| {
            let value = PossibleValue::new(choice.name()).help(choice.help());
            match choice {
                // Batch files have true and false.
                Choice::Off => value.alias("false"),
                Choice::On => value.alias("true"),
                Choice::Auto => value,
            }
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
        let arg = if unnamed == Choice::Off { arg.default_value_if("preset", "thumbnail", "off") } else { arg };
        match is_switch {
            true => arg.num_args(0..=1).require_equals(true).default_missing_value(Choice::On.name()),
            false => arg,
        }
    }
}

impl Args for TechniqueFlags {
    fn augment_args(command: Command) -> Command {
        command.args(Technique::ALL.map(Self::flag))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl FromArgMatches for TechniqueFlags {
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

/// Value of `--preset`: other defaults of some flags. The values are in `args.rs`, as conditional defaults.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    Thumbnail,
    Product,
    Final,
}

bismar_scene::named_variants! { Preset { Thumbnail = "thumbnail", Product = "product", Final = "final" } }

impl Preset {
    /// The flags that it stands for.
    pub fn flags(self) -> &'static str {
        match self {
            Self::Thumbnail => "--size 512x512 --spp 16 --aov none --adaptive off --guiding off --path-reuse off",
            Self::Product => "--size 1024x1024 --spp 256 --ground shadow",
            Self::Final => "--size 1920x1080 --spp 1024 --checkpoint 60",
        }
    }

    /// Whether it denoises where Open Image Denoise is installed.
    pub fn denoises(self) -> bool {
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
    let named = |name: String| Preset::ALL.into_iter().find(|preset| preset.name() == name).ok_or("unknown value");
    PossibleValuesParser::new(names).try_map(named)
}

pub fn blades(text: &str) -> Parsed<u32> {
    text.parse().ok().filter(|n| *n == 0 || (3..=32).contains(n)).ok_or("not a number from 3 to 32, nor 0".into())
}

pub fn share(text: &str) -> Parsed<f64> {
    text.parse().ok().filter(|x: &f64| *x > 0.0 && *x < 1.0).ok_or("not a number above 0 and below 1".into())
}

/// Value of `--part`: K/N; or `auto` or `auto/N`, for the part of this task of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartFlag {
    /// The part.
    pub part: Part,
    /// Whether the scheduler chose it, so that all parts have one command.
    pub is_auto: bool,
}

pub fn part_flag(text: &str) -> Parsed<PartFlag> {
    match text.strip_prefix("auto") {
        Some(rest) => array_task().and_then(|task| part_of(task, rest)).map(|part| PartFlag { part, is_auto: true }),
        None => text.parse().map(|part| PartFlag { part, is_auto: false }),
    }
}

/// The part of a task of an array; `rest` is what follows `auto`.
fn part_of(task: ArrayTask, rest: &str) -> Parsed<Part> {
    let ArrayTask { number, of } = task;
    let given = match rest.strip_prefix('/') {
        Some(count) => Some(count.parse().ok().filter(|n| *n > 0).ok_or("not auto/N with N parts, as in auto/8")?),
        None if rest.is_empty() => None,
        None => return Err("not auto nor auto/N, as in auto/8".into()),
    };
    let of = given.or(of).ok_or("the scheduler does not tell the number of parts: write auto/N, as in auto/8")?;
    if number > of {
        return Err(format!("this is task {number} of the array, but there are {of} parts"));
    }
    Ok(Part { number, of })
}

/// Parser of `--light-radius`.
pub fn light_radius(text: &str) -> Parsed<f32> {
    not_negative(text).ok().filter(|x| *x <= MAX_RADIUS).ok_or(format!("not metres from 0 to {MAX_RADIUS:e}"))
}

/// Parser of `--env-strength`.
pub fn env_strength(text: &str) -> Parsed<f32> {
    let most = Environment::MAX_STRENGTH;
    not_negative(text).ok().filter(|x| *x <= most).ok_or(format!("not a number from 0 to {most:e}"))
}

/// Parser of `--sun-angle`.
pub fn sun_angle(text: &str) -> Parsed<f32> {
    not_negative(text).ok().filter(|x| *x <= 180.0).ok_or("not degrees from 0 to 180".into())
}

/// A switch that is on by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum OnByDefault {
    #[default]
    On,
    Off,
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
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AovList(pub Vec<Aov>);

pub fn aov_list(text: &str) -> Parsed<AovList> {
    let one = |name: &str| {
        let name = name.trim();
        Aov::ALL.into_iter().find(|aov| aov.name() == name).ok_or_else(|| {
            let names = Aov::ALL.map(Aov::name).join(", ");
            format!("there is no AOV '{name}'; there are {names}, all and none")
        })
    };
    match text {
        "none" => Ok(AovList(Vec::new())),
        "all" => Ok(AovList(Aov::ALL.to_vec())),
        list => list.split(',').map(one).collect::<Parsed<_>>().map(AovList),
    }
}

/// `X,Y[,N]`: a pixel of the full picture from the top left, and the index of one of its paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelPath {
    pub pixel: [u32; 2],
    pub path: Option<u32>,
}

pub fn pixel_path(text: &str) -> Parsed<PixelPath> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y]) => Ok(PixelPath { pixel: [x, y], path: None }),
        Some(&[x, y, n]) => Ok(PixelPath { pixel: [x, y], path: Some(n) }),
        _ => Err("not X,Y or X,Y,N: a pixel from the top left and the index of a path, as in 17,4,3".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_task_of_an_array_is_a_part() {
        let task = |number, of| ArrayTask { number, of };
        assert_eq!(part_of(task(3, Some(8)), ""), Ok(Part { number: 3, of: 8 }));
        assert_eq!(part_of(task(3, None), "/4"), Ok(Part { number: 3, of: 4 }));
        // The number of parts that the command states wins: arrays can be larger.
        assert_eq!(part_of(task(3, Some(8)), "/4"), Ok(Part { number: 3, of: 4 }));
        for (task, rest, why) in [
            (task(3, None), "", "write auto/N"),
            (task(5, None), "/4", "task 5 of the array, but there are 4 parts"),
            (task(1, None), "/0", "not auto/N"),
            (task(1, Some(2)), "matic", "not auto nor"),
        ] {
            assert!(part_of(task, rest).unwrap_err().contains(why), "{rest}");
        }
    }

    #[test]
    fn sizes_windows_and_lists_are_read_or_refused() {
        assert_eq!(crop("0,1,2,3"), Ok([0, 1, 2, 3]));
        for bad in ["", "1,2,3", "2,0,1,5", "0,0,0,1", "0,0,1,1,1", "-1,0,1,1"] {
            assert!(crop(bad).is_err(), "{bad}");
        }
        assert_eq!(aov_list("depth, normal"), Ok(AovList(vec![Aov::Depth, Aov::Normal])));
        assert_eq!(aov_list("all").map(|l| l.0.len()), Ok(19));
        assert_eq!(aov_list("variance,samples,balance"), Ok(AovList(Aov::DEFAULT.to_vec())));
        assert!(aov_list("depth,,normal").is_err());
    }

    #[test]
    fn places_are_read_or_refused() {
        assert_eq!(pixel_path("17,4"), Ok(PixelPath { pixel: [17, 4], path: None }));
        assert_eq!(pixel_path("0, 0,12"), Ok(PixelPath { pixel: [0, 0], path: Some(12) }));
        for bad in ["", "1", "1,", "-1,2", "1,2,3,4", "a,b", "1.5,2", "99999999999,1"] {
            assert!(pixel_path(bad).is_err(), "{bad}");
        }
    }
}
