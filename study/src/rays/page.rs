//! What was measured, for people: `report.html` and its charts.

use std::path::Path;

use bismar::{Error, Result};

use super::compare;
use super::host::drift;
use super::measure::CONTROL;
use super::table::{Agreement, Build, MOST_Z, Results, Trace, write_bytes};
use crate::report::page::chart_figure;
use crate::report::{Axis, Chart, Dot, DotPlot, Page, Scale, Series, Table, Tone, number, with_error};

/// The baseline's name.
pub(super) const BASELINE: &str = "embree";
/// Shown in charts, as many as there are colours, each with its own.
const SHOWN: [(&str, usize); 8] = [
    ("embree", 0),
    ("embree+high", 1),
    ("embree+low", 5),
    ("embree+single", 3),
    ("obvhs", 2),
    ("obvhs+fastest", 6),
    ("obvhs+very-slow", 4),
    ("obvhs+bvh2", 7),
];
/// The stream that stands for all in charts.
const STREAM: &str = "diffuse";
/// Charts of the page's top, by the names of their files.
type Charts = Vec<(String, Chart)>;

/// Writes tables, `report.html` and `charts/`.
///
/// # Errors
/// As [`bismar::film::atomic::write`].
pub fn write(folder: &Path, results: &Results) -> Result<()> {
    results.write(folder)?;
    let charts = folder.join("charts");
    std::fs::create_dir_all(&charts)
        .map_err(|e| Error::CannotCreate(format!("{}: cannot create: {e}", charts.display())))?;
    if let Some(plot) = overview(results) {
        write_bytes(&charts.join("overview.svg"), plot.file().as_bytes())?;
    }
    let scenes = scenes(results);
    let all = costs(results).into_iter().chain(scenes.iter().map(|s| (format!("{}-picture", s.file()), s.picture())));
    for (name, chart) in all {
        write_bytes(&charts.join(format!("{name}.svg")), chart.file().as_bytes())?;
    }
    write_bytes(&folder.join("report.html"), page(results, &scenes).as_bytes())
}

/// The rows of one scene on one machine.
struct SceneRows<'a> {
    results: &'a Results,
    machine: &'a str,
    name: &'a str,
    triangles: u64,
}

fn scenes(results: &Results) -> Vec<SceneRows<'_>> {
    let mut all: Vec<SceneRows> = Vec::new();
    for row in &results.builds {
        if !all.iter().any(|s| s.machine == row.machine && s.name == row.scene) {
            all.push(SceneRows { results, machine: &row.machine, name: &row.scene, triangles: row.triangles });
        }
    }
    all.sort_by_key(|s| s.triangles);
    all
}

impl<'a> SceneRows<'a> {
    fn traces(&self) -> impl Iterator<Item = &'a Trace> {
        let (machine, name) = (self.machine, self.name);
        self.results.traces.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn builds(&self) -> impl Iterator<Item = &'a Build> {
        let (machine, name) = (self.machine, self.name);
        self.results.builds.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn agreements(&self) -> impl Iterator<Item = &'a Agreement> {
        let (machine, name) = (self.machine, self.name);
        self.results.agreements.iter().filter(move |r| r.machine == machine && r.scene == name)
    }

    fn base_build(&self) -> Option<&'a Build> {
        self.builds().next()
    }

    /// With its machine, where there are several.
    fn title(&self) -> String {
        let several = self.results.builds.iter().any(|b| b.machine != self.machine);
        if several { format!("{}, {}", self.name, self.machine) } else { self.name.to_owned() }
    }

    fn file(&self) -> String {
        let machines = self.results.hosts.iter().map(|h| &h.machine).collect::<Vec<_>>();
        match machines.iter().position(|m| **m == self.machine) {
            None | Some(0) => self.name.to_owned(),
            Some(other) => format!("{}-machine{}", self.name, other + 1),
        }
    }

    /// Build and render against paths a pixel.
    fn picture(&self) -> Chart {
        let rows = self.results.pictures.iter().filter(|r| r.machine == self.machine && r.scene == self.name);
        let line = |r: &super::table::Picture| {
            let name = if r.backend == CONTROL { BASELINE } else { &r.backend };
            let color = SHOWN.iter().find(|(shown, _)| *shown == name)?.1;
            let at = |spp: f64| (spp, r.build_cpu_seconds + spp * r.cpu_seconds_per_spp);
            let points = (0..=10).map(|i| at(f64::from(1 << i))).collect();
            Some(Series { name: name.to_owned(), points, color })
        };
        let side = self.results.pictures.first().map_or(0.0, |p| (p.pixels as f64).sqrt());
        let labels = ["paths a pixel", "CPU seconds, build and render"];
        let title = format!("Time to a picture of {side:.0} x {side:.0}");
        let mut chart = Chart::fitted(&title, labels, [Scale::Log; 2], rows.filter_map(line).collect());
        chart.dots = false;
        chart
    }
}

fn overview(results: &Results) -> Option<DotPlot> {
    let scenes = scenes(results);
    let there = |name: &str| results.traces.iter().any(|t| t.backend == name);
    let mut kinds = vec![(CONTROL, 0)];
    kinds.extend(SHOWN.into_iter().skip(1).filter(|(name, _)| there(name)));
    let dots = |scene: &SceneRows| {
        let of = |(kind, (name, _)): (usize, &(&str, usize))| {
            let row = scene.traces().find(|t| t.stream == STREAM && t.backend == *name)?;
            Some(Dot { value: row.speed_ratio, error: row.speed_ratio_se, kind })
        };
        (scene.title(), kinds.iter().enumerate().filter_map(of).collect::<Vec<_>>())
    };
    let rows = scenes.iter().map(dots).collect::<Vec<_>>();
    if rows.is_empty() {
        return None;
    }
    let values = rows.iter().flat_map(|(_, dots)| dots.iter().map(|d| d.value)).chain([0.8, 1.25]);
    Some(DotPlot {
        title: "Speed of diffuse bounces over that of embree, one thread".to_owned(),
        label: "median of rounds; bars: two standard errors either way; right is faster".to_owned(),
        axis: Axis::fit(Scale::Log, values),
        mark: Some((1.0, "as embree".to_owned())),
        kinds: kinds.iter().map(|(name, color)| ((*name).to_owned(), *color)).collect(),
        rows,
    })
}

/// Build and trace over the number of triangles, for each kind of generated scene of which a machine measured several sizes.
fn costs(results: &Results) -> Charts {
    let machines = backends(results.hosts.iter().map(|h| &*h.machine));
    let of_machine = |(i, machine): (usize, &&str)| {
        let rows = results.builds.iter().filter(|b| b.machine == **machine);
        let mut shapes = rows.filter_map(|b| Some((i, b.shape.clone()?))).collect::<Vec<_>>();
        shapes.sort();
        shapes.dedup();
        shapes
    };
    let mut charts = Vec::new();
    for (i, shape) in machines.iter().enumerate().flat_map(of_machine) {
        let is = |machine: &str, own: &Option<String>| machine == machines[i] && own.as_ref() == Some(&shape);
        let (of, file) = match i {
            0 => (String::new(), String::new()),
            i => (format!(", {}", machines[i]), format!("-machine{}", i + 1)),
        };
        let lines = |of: &dyn Fn(&str) -> Vec<(f64, f64)>| {
            let line = |&(name, color): &(&str, usize)| {
                let mut points = of(name);
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Series { name: name.to_owned(), points, color }
            };
            SHOWN.iter().map(line).filter(|s| s.points.len() > 1).collect::<Vec<_>>()
        };
        let builds = lines(&|name| {
            let rows = results.builds.iter().filter(|b| is(&b.machine, &b.shape) && b.backend == name);
            rows.map(|b| (b.built_triangles as f64, b.cpu_seconds)).collect()
        });
        let traces = lines(&|name| {
            let rows =
                results.traces.iter().filter(|t| is(&t.machine, &t.shape) && t.backend == name && t.stream == STREAM);
            // By the ratio: contenders of a scene are measured one after the other, and the machine may change its pace.
            let base = |t: &Trace| {
                let is = |b: &&Trace| b.machine == t.machine && b.scene == t.scene && b.stream == STREAM;
                results.traces.iter().filter(is).find(|b| b.backend == BASELINE).map(|b| b.mrays_per_second)
            };
            rows.filter_map(|t| Some((t.triangles as f64, 1e3 / (base(t)? * t.speed_ratio)))).collect()
        });
        if builds.is_empty() {
            continue;
        }
        let log = [Scale::Log; 2];
        let title = format!("Building: {shape}{of}");
        charts.push((
            format!("cost-build-{shape}{file}"),
            Chart::fitted(&title, ["triangles", "CPU seconds, all threads"], log, builds),
        ));
        let title = format!("Tracing diffuse bounces: {shape}{of}");
        charts.push((
            format!("cost-trace-{shape}{file}"),
            Chart::fitted(&title, ["triangles", "nanoseconds a ray, one thread"], log, traces),
        ));
    }
    charts
}

fn page(results: &Results, scenes: &[SceneRows]) -> String {
    let differing = results.differing_pictures();
    let rays = results.agreements.iter().map(|a| a.rays).sum::<u64>();
    let verdict = match (results.unexplained(), differing) {
        (0, 0) => format!("They agree: rounding explains every difference among {rays} compared answers."),
        (hits, pictures) => {
            format!("They do not agree: {hits} of {rays} answers and {pictures} pictures differ without explanation.")
        }
    };
    let lead = format!(
        "Embree and obvhs on the same triangles and the same recorded rays: {} scene{}, every contender in turn with `embree` \
         as the renderer uses it. {verdict}",
        scenes.len(),
        if scenes.len() == 1 { "" } else { "s" },
    );
    let mut page = Page::new("Ray study", &lead);
    page.section("Overview");
    if let Some(plot) = overview(results) {
        page.wide(&plot.svg(), "`embree (again)` is the baseline built a second time: where it is not at 1 is noise.");
    }
    page.heading("Over all scenes");
    page.text("Geometric means over the scenes that a contender was measured on, relative to `embree` there.");
    page.table(&averages(results, scenes));
    let costs = costs(results);
    if !costs.is_empty() {
        page.section("Cost over the number of triangles");
        page.row(&costs.iter().map(|(_, chart)| chart_figure(&chart.svg(), "")).collect::<Vec<_>>());
    }
    compare::section(&mut page, results);
    method(&mut page, results);
    for scene in scenes {
        scene_section(&mut page, scene);
    }
    if !results.notes.is_empty() {
        page.section("Notes");
        results.notes.iter().for_each(|note| page.text(note));
    }
    hosts(&mut page, results);
    page.finish()
}

/// In the order in which they were measured, the baseline first.
fn backends<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut all: Vec<&str> = Vec::new();
    for name in names {
        if !all.contains(&name) {
            all.push(name);
        }
    }
    all
}

fn streams(results: &Results) -> Vec<&str> {
    backends(results.traces.iter().map(|t| &*t.stream))
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.filter(|v| *v > 0.0).fold((0.0, 0), |(s, n), v| (s + v.ln(), n + 1));
    if n == 0 { f64::NAN } else { (sum / f64::from(n)).exp() }
}

fn averages(results: &Results, scenes: &[SceneRows]) -> Table {
    let streams = streams(results);
    let mut columns = vec![("contender", "Backend with its choices"), ("scenes", "How many it was measured on")];
    let speed = "Geometric mean over scenes of the speed over that of embree: above 1 is faster";
    columns.extend(streams.iter().map(|s| (*s, speed)));
    columns.extend([
        ("build", "Geometric mean over scenes of the CPU seconds of a build over those of embree: below 1 is faster"),
        ("memory", "Geometric mean over scenes of the bytes of the structure over those of embree"),
        (
            "picture",
            "Geometric mean over scenes of the speed of a whole render over that with embree, without the build",
        ),
        ("unexplained", "Answers that differ from embree's without an explanation, over all scenes"),
    ]);
    let mut table = Table::new(&columns);
    for name in backends(results.builds.iter().map(|b| &*b.backend)) {
        let tone = if name == CONTROL || name == BASELINE { Tone::Faint } else { Tone::Plain };
        let built = scenes.iter().filter_map(|s| Some((s.base_build()?, s.builds().find(|b| b.backend == name)?)));
        let built = built.collect::<Vec<_>>();
        let mut row = vec![(name.to_owned(), tone), (built.len().to_string(), tone)];
        for stream in &streams {
            let rows = results.traces.iter().filter(|t| t.backend == name && t.stream == *stream);
            let mean = geometric_mean(rows.map(|t| t.speed_ratio));
            let own = if tone == Tone::Faint { tone } else { judged(mean, 0.02) };
            row.push((number(mean), own));
        }
        let ratio = |of: &dyn Fn(&Build) -> f64| geometric_mean(built.iter().map(|(base, own)| of(own) / of(base)));
        row.push((number(ratio(&|b| b.cpu_seconds)), tone));
        row.push((number(ratio(&|b| b.bytes_per_triangle)), tone));
        let pictures = results.pictures.iter().filter(|p| p.backend == name);
        row.push((number(geometric_mean(pictures.map(|p| p.speed_ratio))), tone));
        let unexplained = results.agreements.iter().filter(|a| a.backend == name).map(|a| a.unexplained).sum::<u64>();
        row.push((unexplained.to_string(), if unexplained > 0 { Tone::Bad } else { tone }));
        table.rows.push(row);
    }
    table
}

/// Good above 1, bad below, beyond two errors.
fn judged(ratio: f64, error: f64) -> Tone {
    match () {
        () if ratio - 2.0 * error > 1.0 => Tone::Good,
        () if ratio + 2.0 * error < 1.0 => Tone::Bad,
        () => Tone::Plain,
    }
}

fn scene_section(page: &mut Page, scene: &SceneRows) {
    page.section(&scene.title());
    let streams = backends(scene.traces().map(|t| &*t.stream));
    let sizes = streams.iter().filter_map(|s| scene.traces().find(|t| t.stream == *s));
    let sizes = sizes.map(|t| format!("{} {} rays, {:.0} % of them hit", t.stream, t.rays, 100.0 * t.hit_share));
    page.text(&format!("{} triangles. Streams: {}.", scene.triangles, sizes.collect::<Vec<_>>().join("; ")));
    page.row(&[chart_figure(
        &scene.picture().svg(),
        "Measured build, and measured seconds a path times the number of paths. Where lines cross, the longer build has paid.",
    )]);
    page.heading("Mrays/s of one thread, and speed over that of embree");
    let mut columns = vec![("contender", "Backend with its choices")];
    for stream in &streams {
        columns.push((stream, "Million rays a CPU second, median of the rounds"));
        columns.push(("", "Speed over that of embree in the same rounds, with the standard error of the median"));
    }
    let mut table = Table::new(&columns);
    let names = backends(scene.builds().map(|b| &*b.backend));
    for name in &names {
        let mut row = vec![((*name).to_owned(), Tone::Plain)];
        for stream in &streams {
            let found = scene.traces().find(|t| t.backend == *name && t.stream == *stream);
            let (rate, ratio, tone) = match found {
                None => (String::new(), String::new(), Tone::Plain),
                Some(t) if t.speed_ratio_se == 0.0 && t.speed_ratio == 1.0 => {
                    (number(t.mrays_per_second), String::new(), Tone::Faint)
                }
                Some(t) => (
                    number(t.mrays_per_second),
                    with_error(t.speed_ratio, t.speed_ratio_se),
                    judged(t.speed_ratio, t.speed_ratio_se.max(0.01)),
                ),
            };
            row.extend([(rate, Tone::Plain), (ratio, tone)]);
        }
        table.rows.push(row);
    }
    page.table(&table);
    page.heading("Building, and pictures");
    page.table(&builds(scene, &names));
    page.details("Agreement with embree, answer by answer", |page| page.table(&agreement(scene)));
}

fn builds(scene: &SceneRows, names: &[&str]) -> Table {
    let mut table = Table::new(&[
        ("contender", "Backend with its choices"),
        ("build, CPU s", "Processor seconds of all threads, median of the builds"),
        ("wall s", "Seconds with all threads; what else the machine did counts"),
        ("one thread, s", "Wall seconds with one thread"),
        ("bytes/triangle", "Of the finished structure, as the library counts them"),
        ("peak, library", "Bytes a triangle that the library held at most while building, where it says so"),
        ("peak, process", "Bytes a triangle by which the process grew at most while building, by the system's count"),
        ("picture, ms/spp", "CPU milliseconds of one path in every pixel, without the build"),
        ("speed", "Of a picture over that with embree in the same rounds"),
        ("crossover, spp", "Paths a pixel from which on the longer build has paid"),
        ("z", "Picture mean against that with embree, other seeds, in standard errors, worst channel"),
        ("instructions", "Instructions of the processor for one ray of a diffuse bounce; where counters are there"),
        ("threads", "Speed of diffuse bounces with all threads over that with one, by the wall clock"),
    ]);
    for name in names {
        let Some(build) = scene.builds().find(|b| b.backend == *name) else { continue };
        let of_scene =
            |machine: &str, own: &str, backend: &str| machine == scene.machine && own == scene.name && backend == *name;
        let results = scene.results;
        let picture = results.pictures.iter().find(|p| of_scene(&p.machine, &p.scene, &p.backend));
        let scaling = results.scalings.iter().find(|s| of_scene(&s.machine, &s.scene, &s.backend));
        let diffuse = scene.traces().find(|t| t.backend == *name && t.stream == STREAM);
        let text = |value: Option<f64>| value.map_or(String::new(), number);
        let plain = |text: String| (text, Tone::Plain);
        table.rows.push(vec![
            plain((*name).to_owned()),
            plain(number(build.cpu_seconds)),
            plain(number(build.wall_seconds)),
            plain(text(build.one_thread_seconds)),
            plain(number(build.bytes_per_triangle)),
            plain(text(build.peak_bytes_per_triangle)),
            plain(number(build.peak_process_bytes_per_triangle)),
            plain(text(picture.map(|p| 1e3 * p.cpu_seconds_per_spp))),
            picture.map_or(plain(String::new()), |p| {
                (with_error(p.speed_ratio, p.speed_ratio_se), judged(p.speed_ratio, p.speed_ratio_se.max(0.01)))
            }),
            plain(text(picture.and_then(|p| p.crossover_spp))),
            picture.map_or(plain(String::new()), |p| {
                (number(p.bias_z), if p.bias_z.abs() > MOST_Z { Tone::Bad } else { Tone::Plain })
            }),
            plain(text(diffuse.and_then(|t| t.instructions_per_ray))),
            plain(scaling.map_or(String::new(), |s| format!("{}: {}", s.threads, with_error(s.speedup, s.speedup_se)))),
        ]);
    }
    table
}

fn agreement(scene: &SceneRows) -> Table {
    let mut table = Table::new(&[
        ("contender", "Backend with its choices"),
        ("stream", "Which rays"),
        ("rays", "Compared answers"),
        ("edge", "Different triangles, within rounding of an edge"),
        ("coplanar", "Different triangles at the same distance, within rounding"),
        ("grazing", "The ray lies in the triangle's plane, nearly"),
        ("self", "Within rounding of where the ray's interval starts or ends"),
        ("alpha", "The texel at which alpha is looked up differs"),
        ("miss", "One slipped through at an edge and hit nothing"),
        ("unexplained", "Rounding does not explain it"),
    ]);
    for row in scene.agreements().filter(|a| a.same < a.rays) {
        let mut cells = vec![(row.backend.clone(), Tone::Plain), (row.stream.clone(), Tone::Plain)];
        let counts = [row.rays, row.edge, row.coplanar, row.grazing, row.self_hit, row.alpha, row.miss];
        cells.extend(counts.map(|n| (n.to_string(), Tone::Plain)));
        cells.push((row.unexplained.to_string(), if row.unexplained > 0 { Tone::Bad } else { Tone::Plain }));
        table.rows.push(cells);
    }
    table
}

fn method(page: &mut Page, results: &Results) {
    page.details("How this was measured, and how sure it is", |page| {
        page.text(
            "The rays are those that renders of the scene asked for, recorded batch by batch with `embree` and replayed to every \
             contender alike. Camera, shadow and later bounces are from a path-traced picture of the scene as it is; diffuse and \
             glossy are first bounces with all surfaces made diffuse, or metals of roughness ¼; shuffled and sorted (by octant, \
             then along a Morton curve through the origins) are the diffuse ones in another order. Shadow rays ask for any hit, \
             all others for the closest one with its weights and ids, which are written out as the renderer needs them: the \
             times include that, for all contenders.",
        );
        page.text(&format!(
            "Contender and baseline take turns, {} rounds, first and second by turns. A speed ratio is the median over rounds of \
             the ratio within a round, ± is the standard error of that median (from the median deviation). Seconds are processor \
             seconds of one thread: other programs on the same cores do not count, though they take from caches and \
             memory bandwidth. All threads flush denormals to zero, for both libraries.",
            results.rounds
        ));
        page.text(
            "Builds begin at the scene's vertex and index buffers and end where rays can be shot; Embree shares the buffers, \
             obvhs' triangles and ids are copied into the order of the leaves. Builds shorter than half a second are repeated. \
             Triangles are counted once for each time that they are built.",
        );
        page.text(
            "`embree` hands rays over in packets as wide as the processor has them, kept together for camera rays and in small \
             scenes; `single` calls for each ray, `x4` to `x16` keep packets together in the batch's order for every stream. \
             `obvhs` is its compressed eight-wide tree by the medium preset; boxes grow by a millionth of the scene so that \
             rounding loses no hit; the triangle test is Embree's, written in Rust; `own-test` is obvhs' own one.",
        );
        page.text(
            "Agreement: where two answers differ in anything, the ray and the triangles are intersected again in double precision, \
             with bounds on the rounding of single precision (forty operations, as in the tests of the backends). An answer that \
             the bounds exclude, or a nearer triangle that was passed by though the bounds demand it, is unexplained, and makes the \
             study fail.",
        );
    });
}

fn hosts(page: &mut Page, results: &Results) {
    page.section("The machine");
    for (i, host) in results.hosts.iter().enumerate() {
        let earlier = results.hosts[..i].iter().filter(|h| h.machine == host.machine).count();
        let run = if earlier == 0 { String::new() } else { format!(", run {}", earlier + 1) };
        page.heading(&format!("{}{run}", host.machine));
        let counters = if host.hardware_counters {
            "there; they counted the instructions of one replay a stream"
        } else {
            "none that this program may use, so instructions a ray were not measured"
        };
        page.text(&format!(
            "{}{}; {} cores, {:.0} GiB; Linux {}; frequency governor {}. Embree {} runs on {}, obvhs {} and the program are \
             compiled for {}. Measuring threads {} results to zero and {} denormal operands as zero. Hardware counters: {counters}.",
            host.cpu,
            if host.virtual_machine { " in a virtual machine" } else { "" },
            host.cores,
            host.memory_bytes as f64 / f64::from(1 << 30),
            host.kernel,
            host.frequency_governor.as_deref().unwrap_or("unknown"),
            host.embree,
            host.embree_isa,
            host.obvhs,
            host.isa_baseline,
            if host.flush_to_zero { "flush" } else { "do not flush" },
            if host.denormals_are_zero { "take" } else { "do not take" },
        ));
        page.text(&format!(
            "Load {:.1} before and {:.1} at the end{}; {:.1} % of the time was given to other machines. Between contenders a fixed \
             computation and a fixed walk through 64 MiB of memory were timed in processor seconds: the computation drifted by a \
             factor of {:.3}, the walk by {:.3} (ninth over first tenth of {} readings).",
            host.load_before,
            host.load_after,
            if host.load_before > host.cores as f64 || host.load_after > host.cores as f64 {
                ", more than there are cores: caches and memory were shared, and wall seconds and scaling mean little"
            } else {
                ""
            },
            100.0 * host.stolen_share,
            drift(&host.spin_seconds),
            drift(&host.chase_seconds),
            host.spin_seconds.len()
        ));
        let line = |name: &str, seconds: &[f64], color: usize| {
            let first = seconds.first().copied().unwrap_or(1.0);
            let points = seconds.iter().enumerate().map(|(i, s)| (i as f64, s / first)).collect();
            Series { name: name.to_owned(), points, color }
        };
        let series = vec![line("computation", &host.spin_seconds, 1), line("memory", &host.chase_seconds, 2)];
        let labels = ["reading", "seconds over the first reading"];
        let chart = Chart::fitted("Steadiness of the machine", labels, [Scale::Linear; 2], series);
        page.row(&[chart_figure(&chart.svg(), "")]);
    }
}
