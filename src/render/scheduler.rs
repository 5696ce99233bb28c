//! Which pass is next and when to stop: functions of settings and of what has been done, nothing else.

use super::adaptive::GROWTH;
use super::{RenderSettings, StopReason};
use crate::balance::method::{EARLY, up_to};

/// How far a render is.
#[derive(Debug, Clone, Copy)]
pub struct State {
    /// Fewest paths of a tile that is not clean.
    pub done: u32,
    /// Most paths of such a tile: more than `done` after an interruption in the middle of a pass.
    pub ahead: u32,
    /// Most paths that a tile is to have, if it is known.
    pub goal: Option<u32>,
    /// Passes completed.
    pub passes: u32,
    /// Passes after which a study stops ([`StudyOptions`](super::StudyOptions)).
    pub max_passes: Option<u32>,
    /// Is every tile as clean as asked?
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
    /// Take every pixel to `done` and so many paths.
    Pass(u32),
    /// End.
    Stop(StopReason),
}

/// Paths a pixel of the pass that begins after `done` paths, if nothing cuts it short; `None` when the samples are taken.
pub fn planned(settings: &RenderSettings, done: u32) -> Option<u32> {
    planned_to(settings, settings.spp, done)
}

/// The same for pixels with a goal of their own.
pub fn planned_to(settings: &RenderSettings, goal: Option<u32>, done: u32) -> Option<u32> {
    let method = settings.balance.method();
    let mut pass = method.next_pass(done, goal, settings.pilot)?;
    if settings.noise_goal().is_some_and(|noise| done >= noise.least) {
        pass = up_to(goal, done, done.saturating_mul(GROWTH))?;
    }
    Some(if is_early(settings, done) { pass.min(done.max(1)).min(EARLY - done) } else { pass })
}

/// Is the pass that begins after `done` paths one of the small ones that come first against the clock? Not for methods
/// whose shares follow from their passes: a few paths would teach them nonsense.
pub fn is_early(settings: &RenderSettings, done: u32) -> bool {
    let method = settings.balance.method();
    settings.time.is_some() && done < EARLY && !method.needs_goal() && !method.sums_moments()
}

/// The next pass, or why there is none.
pub fn next(settings: &RenderSettings, state: &State) -> Next {
    let State { done, ahead, .. } = *state;
    if state.clean {
        return Next::Stop(StopReason::Noise);
    }
    // A pass that an interruption has left half-way is finished first: then no bit can tell.
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
        // What fits into the time that is left, by what a path has cost so far.
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

/// Why a render must end at once, even in the middle of a pass.
pub fn cut(settings: &RenderSettings, seconds: f64, stopped: bool) -> Option<StopReason> {
    if stopped {
        return Some(StopReason::Interrupted);
    }
    settings.time.filter(|limit| seconds >= *limit).map(|_| StopReason::Time)
}

/// The share in [0, 1] that is done of the stop rule that is nearest, after `paths` paths a pixel, where a share of
/// `clean` of all tiles is as clean as asked.
pub fn fraction(settings: &RenderSettings, paths: f64, seconds: f64, clean: f64) -> f64 {
    let by_samples = settings.spp.map_or(0.0, |goal| paths / f64::from(goal));
    let by_time = settings.time.map_or(0.0, |limit| seconds / limit);
    by_samples.max(by_time).max(clean).clamp(0.0, 1.0)
}

/// Do passes of these settings come to so many paths?
pub fn is_planned(settings: &RenderSettings, paths: u32) -> bool {
    let mut done = 0;
    while done < paths {
        let Some(pass) = planned(settings, done) else { return false };
        done += pass;
    }
    done == paths
}

/// Are these the passes that a render of these settings begins with? Then it ends with the same bits. Else its passes
/// were cut by another goal or by time: the picture is as right, but another one.
pub fn is_on_the_way(settings: &RenderSettings, done: u32, ahead: u32, passes_done: u32) -> bool {
    let (mut paths, mut passes) = (0, 0);
    while paths < ahead {
        let Some(pass) = planned(settings, paths) else { return false };
        if paths == done && passes == passes_done {
            // The pass that is half-way.
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
        RenderSettings { spp, balance: Balance::Half, ..Default::default() }
    }

    fn after(done: u32) -> State {
        State {
            done,
            ahead: done,
            goal: None,
            passes: 0,
            max_passes: None,
            clean: false,
            seconds: 1.0,
            render_seconds: 1.0,
            stopped: false,
        }
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
        let time = |balance, spp| RenderSettings { spp, time: Some(9.0), balance, ..Default::default() };
        assert_eq!(passes(&time(Balance::Progressive, None)), [1, 1, 2, 32, 36, 72, 128]);
        assert_eq!(passes(&time(Balance::Progressive, Some(150))), [1, 1, 2, 128, 18]);
        assert_eq!(passes(&time(Balance::EfficiencyAware, Some(3))), [1, 1, 1]);
        assert_eq!(passes(&time(Balance::Half, None)), [1, 1, 2, 8, 12, 24, 48]);
        assert_eq!(passes(&time(Balance::Kl, None))[..3], [8, 8, 16]);
        assert_eq!(passes(&time(Balance::SecondOrder, Some(64))), [32, 32]);
        // A pass that time cut in between changes nothing of that.
        assert_eq!(planned(&time(Balance::Half, None), 3), Some(1));
        // Without a clock, as ever.
        assert_eq!(passes(&RenderSettings { spp: Some(150), ..Default::default() }), [128, 22]);
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
        assert!(is_on_the_way(&settings, 16, 16, 2));
        assert!(is_on_the_way(&settings, 16, 32, 2));
        assert!(!is_on_the_way(&settings, 16, 24, 2));
        assert!(!is_on_the_way(&settings, 12, 12, 2));
        assert!(is_on_the_way(&settings, 0, 0, 0));
    }
}
