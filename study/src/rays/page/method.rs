//! The sections on method and machine.

use crate::rays::host::drift;
use crate::rays::table::Results;
use crate::report::page::chart_figure;
use crate::report::{Chart, Page, Scale, Series};

pub(super) fn method(page: &mut Page, results: &Results) {
    page.details("How this was measured, and its uncertainty", |page| {
        page.text(
            "The rays are those of renders of the scene, recorded batch by batch with `embree` and replayed to every contender. \
             Camera, shadow and later bounces come from a path-traced picture of the unchanged scene. Diffuse and glossy are first \
             bounces with all surfaces made diffuse, or metals of roughness ¼. Shuffled and sorted (by octant, then along a \
             Morton curve through the origins) are the diffuse rays in another order. Shadow rays query any hit, all others the \
             closest hit with its weights and ids. Times include writing the results in the renderer's layout.",
        );
        page.text(&format!(
            "Contender and baseline take turns, {} rounds, alternating who is first. A speed ratio is the median over rounds of \
             the ratio within a round; ± is the standard error of that median (from the median deviation). Seconds are processor \
             seconds of one thread: other programs on the same cores do not count, although they use caches and memory bandwidth. \
             Denormals are not flushed to zero, as in the renderer, for both libraries.",
            results.rounds
        ));
        page.text(
            "Builds begin at the scene's vertex and index buffers and end when rays can be traced. Embree shares the buffers; \
             obvhs' triangles and ids are copied into the order of the leaves. Builds shorter than half a second are repeated. \
             Triangles are counted once for each time that they are built.",
        );
        page.text(
            "`embree` traces packets as wide as the processor's vectors, coherent ones for camera rays and in small scenes; \
             `single` traces ray by ray, `x4` to `x16` trace packets in the batch's order for every stream. `obvhs` is its \
             compressed eight-wide tree with the medium preset; boxes grow by a millionth of the scene so that rounding loses no \
             hit; the triangle test is Embree's, written in Rust; `own-test` is that of obvhs.",
        );
        page.text(
            "Agreement: where two answers differ, the ray and the triangles are intersected again in double precision, with bounds \
             on the rounding of single precision (forty operations, as in the tests of the backends). An answer that the bounds \
             exclude, or a missed nearer triangle that the bounds demand, is unexplained, and makes the study fail.",
        );
    });
}

pub(super) fn hosts(page: &mut Page, results: &Results) {
    page.section("The machine");
    for (i, host) in results.hosts.iter().enumerate() {
        let earlier = results.hosts[..i].iter().filter(|h| h.machine == host.machine).count();
        let run = if earlier == 0 { String::new() } else { format!(", run {}", earlier + 1) };
        page.heading(&format!("{}{run}", host.machine));
        let counters = if host.hardware_counters {
            "available; they counted the instructions of one replay per stream"
        } else {
            "not available to this program; instructions per ray were not measured"
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
                ", more than the number of cores: caches and memory were shared, so wall seconds and scaling are unreliable"
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
            Series { name: name.to_owned(), points, errors: Vec::new(), color }
        };
        let series = vec![line("computation", &host.spin_seconds, 1), line("memory", &host.chase_seconds, 2)];
        let labels = ["reading", "seconds over the first reading"];
        let chart = Chart::fitted("Steadiness of the machine", labels, [Scale::Linear; 2], series);
        page.row([chart_figure(chart.svg(), "")]);
    }
}
