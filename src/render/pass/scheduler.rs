//! Decides which pass is next and when to stop. Pure functions of settings and progress.

use super::adaptive::GROWTH;
use super::stats::StopReason;
use crate::balance::method::{EARLY_PATHS, pass_within_goal};
use crate::render::settings::RenderSettings;
use crate::sampling::hash;

/// Progress of a render.
#[derive(Debug, Clone, Copy, Default)]
pub struct State {
    /// Minimum paths per pixel of the unfinished tiles.
    pub done: u32,
    /// Maximum paths per pixel of the unfinished tiles: more than `done` after an interruption within a pass.
    pub ahead: u32,
    /// Maximum goal of an unfinished tile, if it is known.
    pub goal: Option<u32>,
    /// Passes completed.
    pub passes: u32,
    /// Passes after which a study stops ([`StudyOptions`](crate::render::StudyOptions)).
    pub max_passes: Option<u32>,
    /// Is every tile finished?
    pub clean: bool,
    /// Seconds so far that `--time` counts, over all sessions.
    pub seconds: f64,
    /// Seconds of passes so far, over all sessions.
    pub render_seconds: f64,
    /// Was the stop flag raised?
    pub stopped: bool,
}

/// What to do next.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// Trace this number of paths per pixel.
    Pass(u32),
    /// End.
    Stop(StopReason),
}

/// Paths per pixel of the pass that begins after `done` paths, unless it is interrupted. `None` if all samples are taken.
pub fn planned(settings: &RenderSettings, done: u32) -> Option<u32> {
    planned_to(settings, settings.spp, done)
}

/// The same for pixels with a goal of their own.
pub fn planned_to(settings: &RenderSettings, goal: Option<u32>, done: u32) -> Option<u32> {
    let method = settings.balance.method();
    let mut pass = method.next_pass(done, goal, settings.pilot)?;
    if settings.noise_goal().is_some_and(|noise| done >= noise.min_paths) {
        pass = pass_within_goal(goal, done, done.saturating_mul(GROWTH))?;
    }
    Some(if is_early(settings, done) { pass.min(done.max(1)).min(EARLY_PATHS - done) } else { pass })
}

/// Is the pass that begins after `done` paths one of the short first passes of a render with a time limit? Methods that
/// learn shares from their passes have none: a few paths would give poor estimates.
pub fn is_early(settings: &RenderSettings, done: u32) -> bool {
    let method = settings.balance.method();
    settings.time.is_some() && done < EARLY_PATHS && !method.needs_goal() && !method.sums_moments()
}

/// The seed of a pass that begins after `done` paths.
pub fn pass_seed(settings: &RenderSettings, done: u32) -> u32 {
    let scrambles = settings.balance.method().scrambles_passes();
    settings.seed
        ^ match () {
            // Nothing is learned from these points, and the second-order pilot has none of them.
            () if is_early(settings, done) => hash(u32::MAX),
            () if scrambles => hash(done),
            () => 0,
        }
}

/// The next pass, or why there is none.
pub fn next(settings: &RenderSettings, state: &State) -> Next {
    let State { done, ahead, .. } = *state;
    if state.clean {
        return Next::Stop(StopReason::Noise);
    }
    // A pass that was interrupted is completed first, so that the bits are those of an uninterrupted render.
    let mut pass = ahead - done;
    if pass == 0 {
        let enough = state.max_passes.is_some_and(|max| state.passes >= max);
        match planned_to(settings, state.goal, done) {
            Some(paths) if !enough => pass = paths,
            _ => return Next::Stop(StopReason::Samples),
        }
    }
    if let Some(reason) = cut(settings, state.seconds, state.stopped) {
        return Next::Stop(reason);
    }
    if let Some(limit) = settings.time
        && done > 0
    {
        // The paths that fit into the remaining time, by the mean cost of a path so far.
        let fits = ((limit - state.seconds) * f64::from(done) / state.render_seconds) as u32;
        if fits == 0 {
            return Next::Stop(StopReason::Time);
        }
        if ahead == done {
            pass = pass.min(fits);
        }
    }
    Next::Pass(pass)
}

/// Why a render must end at once, even within a pass.
pub fn cut(settings: &RenderSettings, seconds: f64, stopped: bool) -> Option<StopReason> {
    if stopped {
        return Some(StopReason::Interrupted);
    }
    settings.time.filter(|limit| seconds >= *limit).map(|_| StopReason::Time)
}

/// Finished fraction in [0, 1] by the stop rule that is nearest, after `paths` paths per pixel, where a fraction `clean` of
/// all tiles is finished.
pub fn fraction(settings: &RenderSettings, paths: f64, seconds: f64, clean: f64) -> f64 {
    let by_samples = settings.spp.map_or(0.0, |goal| paths / f64::from(goal));
    let by_time = settings.time.map_or(0.0, |limit| seconds / limit);
    by_samples.max(by_time).max(clean).clamp(0.0, 1.0)
}

/// The numbers of paths at which passes of these settings end, up to the first one that is not below `paths`.
pub fn pass_ends(settings: &RenderSettings, paths: u32) -> Vec<u32> {
    let mut ends = Vec::new();
    let mut done = 0;
    while done < paths
        && let Some(pass) = planned(settings, done)
    {
        done += pass;
        ends.push(done);
    }
    ends
}

/// Does a pass of these settings end at this number of paths?
pub fn is_planned(settings: &RenderSettings, paths: u32) -> bool {
    let mut done = 0;
    while done < paths {
        let Some(pass) = planned(settings, done) else { return false };
        done += pass;
    }
    done == paths
}

/// Are these the passes that a render of these settings begins with? Then it ends with the same bits. Otherwise passes were
/// cut by another goal or by time: the picture is as correct, but has other bits.
pub fn begins_as(settings: &RenderSettings, done: u32, ahead: u32, passes_done: u32) -> bool {
    let (mut paths, mut passes) = (0, 0);
    while paths < ahead {
        let Some(pass) = planned(settings, paths) else { return false };
        if paths == done && passes == passes_done {
            // The interrupted pass.
            return done + pass == ahead;
        }
        (paths, passes) = (paths + pass, passes + 1);
    }
    (paths, passes) == (done, passes_done)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Balance;

    fn half(spp: Option<u32>) -> RenderSettings {
        RenderSettings { spp, balance: Balance::Half, ..RenderSettings::even() }
    }

    fn after(done: u32) -> State {
        State { done, ahead: done, seconds: 1.0, render_seconds: 1.0, ..State::default() }
    }

    #[test]
    fn passes_follow_the_balance_until_the_samples_are_taken() {
        let settings = half(Some(40));
        let (mut state, mut passes) = (State { goal: settings.spp, ..after(0) }, Vec::new());
        while let Next::Pass(paths) = next(&settings, &state) {
            passes.push(paths);
            (state.done, state.ahead) = (state.done + paths, state.done + paths);
        }
        assert_eq!(passes, [8, 8, 16, 8]);
        assert_eq!(next(&settings, &state), Next::Stop(StopReason::Samples));
        let of_two = |passes, done| State { passes, max_passes: Some(2), ..after(done) };
        assert_eq!(next(&settings, &of_two(1, 8)), Next::Pass(8));
        assert_eq!(next(&settings, &of_two(2, 16)), Next::Stop(StopReason::Samples));
    }

    #[test]
    fn a_pass_that_is_half_way_is_finished_whatever_the_goals_say() {
        let settings = RenderSettings { noise: Some(1.0), ..half(Some(32)) };
        let state = State { done: 32, ahead: 64, ..after(32) };
        assert_eq!(next(&settings, &state), Next::Pass(32));
        assert_eq!(next(&settings, &State { stopped: true, ..state }), Next::Stop(StopReason::Interrupted));
    }

    #[test]
    fn a_noise_goal_ends_it_when_every_tile_is_clean() {
        let settings = RenderSettings { noise: Some(0.1), ..half(None) };
        assert_eq!(next(&settings, &State { clean: true, ..after(32) }), Next::Stop(StopReason::Noise));
        assert_eq!(next(&settings, &State { clean: false, ..after(32) }), Next::Pass(96));
        assert_eq!(next(&settings, &after(16)), Next::Pass(16));
    }

    #[test]
    fn time_cuts_a_pass_to_what_fits_and_ends_when_nothing_does() {
        let settings = RenderSettings { time: Some(10.0), ..half(None) };
        let state = |done, seconds| State { seconds, render_seconds: seconds, ..after(done) };
        // No cost is known before the first path.
        assert_eq!(next(&settings, &state(0, 9.999)), Next::Pass(1));
        assert_eq!(next(&settings, &state(64, 5.0)), Next::Pass(64));
        assert_eq!(next(&settings, &state(64, 8.0)), Next::Pass(16));
        assert_eq!(next(&settings, &state(64, 9.9)), Next::Stop(StopReason::Time));
        assert_eq!(next(&settings, &state(0, 10.0)), Next::Stop(StopReason::Time));
        assert_eq!(next(&settings, &State { ahead: 128, ..state(64, 8.0) }), Next::Pass(64));
    }

    #[test]
    fn against_the_clock_the_whole_picture_comes_first() {
        let passes = |settings: &RenderSettings| {
            let mut done = 0;
            let next = || planned(settings, done).inspect(|pass| done += pass);
            std::iter::from_fn(next).take(7).collect::<Vec<_>>()
        };
        let time = |balance, spp| RenderSettings { spp, time: Some(9.0), balance, ..RenderSettings::even() };
        assert_eq!(passes(&time(Balance::Progressive, None)), [1, 1, 2, 32, 36, 72, 128]);
        assert_eq!(passes(&time(Balance::Progressive, Some(150))), [1, 1, 2, 128, 18]);
        assert_eq!(passes(&time(Balance::EfficiencyAware, Some(3))), [1, 1, 1]);
        assert_eq!(passes(&time(Balance::Half, None)), [1, 1, 2, 8, 12, 24, 48]);
        assert_eq!(passes(&time(Balance::Kl, None))[..3], [8, 8, 16]);
        assert_eq!(passes(&time(Balance::SecondOrder, Some(64))), [32, 32]);
        // A pass that time cut in between changes nothing of that.
        assert_eq!(planned(&time(Balance::Half, None), 3), Some(1));
        // Without a clock, as ever.
        assert_eq!(passes(&RenderSettings { spp: Some(150), ..RenderSettings::even() }), [128, 22]);
    }

    #[test]
    fn the_nearest_stop_rule_is_the_progress() {
        let settings = RenderSettings { time: Some(10.0), noise: Some(0.1), ..half(Some(100)) };
        assert_eq!(fraction(&settings, 50.0, 1.0, 0.0), 0.5);
        assert_eq!(fraction(&settings, 50.0, 9.0, 0.2), 0.9);
        assert_eq!(fraction(&settings, 50.0, 1.0, 1.0), 1.0);
    }

    #[test]
    fn passes_cut_by_another_goal_are_not_on_the_way() {
        let settings = half(Some(100));
        assert!(begins_as(&settings, 16, 16, 2));
        assert!(begins_as(&settings, 16, 32, 2));
        assert!(!begins_as(&settings, 16, 24, 2));
        assert!(!begins_as(&settings, 12, 12, 2));
        assert!(begins_as(&settings, 0, 0, 0));
    }
}
