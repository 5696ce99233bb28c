//! The goals that a render was begun and continued with: passes, the guiding field and the allocation of paths depend on
//! them.

use crate::render::pass::goal::Goal;

use crate::render::pass::scheduler;
use crate::render::prepass::allocation::Allocation;
use crate::render::settings::RenderSettings;
use crate::render::settings::techniques::Technique;

/// Adds the goal of a session that takes more passes, unless it is that of the last one.
pub fn add(goals: &mut Vec<Goal>, settings: &RenderSettings, paths: u32) {
    // Without a path since, an earlier goal has had no effect.
    goals.retain(|goal| goal.from < paths);
    let same = |last: &Goal| *last == Goal::of(settings, last.from);
    if !goals.last().is_some_and(same) {
        goals.push(Goal::of(settings, paths));
    }
}

/// Does what pre-passes learn for the goal of `shorter`, of fewer paths or as many, hold for that of `settings`, as far as passes to
/// the former have taken it? Whether techniques are decided about depends on the goal, the allocation does, and so do guiding field
/// and light selection if `by_goal`.
pub fn learned_alike(shorter: &RenderSettings, settings: &RenderSettings, by_goal: bool) -> bool {
    let asked_alike = Technique::ALL.iter().all(|it| shorter.asks_for(*it) == settings.asks_for(*it));
    let allocated_alike =
        Allocation::key(shorter) == Allocation::key(settings) || Allocation::begins_as(shorter, settings);
    asked_alike && allocated_alike && (!by_goal || shorter.expected_spp() == settings.expected_spp())
}

/// Have these goals led to the passes and to what was learned that a render of `settings` has from the beginning? What it learns
/// depends on the goal (`by_goal`) or not. Passes of goals with a time limit are not known.
pub fn are_as_one(goals: &[Goal], settings: &RenderSettings, by_goal: bool) -> bool {
    let allocated = settings.asks_for(Technique::Adaptive);
    let untils = goals.iter().skip(1).map(|next| Some(next.from)).chain([None]);
    goals.iter().zip(untils).all(|(goal, until)| {
        let theirs = goal.instead(settings);
        let passes = |s: &RenderSettings| until.map(|paths| scheduler::pass_ends(s, paths));
        let is_known = !goal.timed && settings.time.is_none() && !allocated;
        learned_alike(&theirs, settings, by_goal) && (!is_known || passes(&theirs) == passes(settings))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Choice;

    fn of(spp: u32) -> RenderSettings {
        RenderSettings { spp: Some(spp), ..RenderSettings::even() }
    }

    #[test]
    fn goals_are_added_where_they_change() {
        let mut goals = Vec::new();
        for (spp, paths) in [(64, 0), (64, 30), (256, 64), (512, 64), (512, 100)] {
            add(&mut goals, &of(spp), paths);
        }
        assert_eq!(goals, [Goal::of(&of(64), 0), Goal::of(&of(512), 64)]);
        add(&mut goals, &of(512), 0);
        assert_eq!(goals, [Goal::of(&of(512), 0)]);
    }

    #[test]
    fn passes_that_another_goal_has_cut_and_fields_of_another_goal_are_found() {
        let went = |goals: &[(u32, u32)]| goals.iter().map(|&(spp, from)| Goal::of(&of(spp), from)).collect::<Vec<_>>();
        // Passes have 128 paths: 64 and 192 are as many passes, but others.
        for (goals, as_one) in [
            (&[(256, 0)][..], true),
            (&[(64, 0), (256, 64)], false),
            (&[(128, 0), (256, 128)], true),
            (&[(128, 0), (200, 128), (256, 200)], false),
            (&[(512, 0), (256, 70)], true),
        ] {
            assert_eq!(are_as_one(&went(goals), &of(256), false), as_one, "{goals:?}");
        }
        assert!(!are_as_one(&went(&[(128, 0), (256, 128)]), &of(256), true));
        assert!(are_as_one(&went(&[(256, 0)]), &of(256), true));
        // Paths are allocated alike from 128 on, and passes are as long.
        let adaptive = |spp| of(spp).with(Technique::Adaptive, Choice::On);
        for (goals, spp, as_one) in [
            (&[(128, 0), (256, 128)][..], 256, true),
            (&[(64, 0), (256, 64)], 256, false),
            (&[(128, 0), (200, 128)], 200, true),
            (&[(128, 0), (200, 128), (256, 200)], 256, false),
            (&[(8, 0), (12, 8)], 12, false),
        ] {
            assert_eq!(are_as_one(&went(goals), &adaptive(spp), false), as_one, "{goals:?}");
        }
        // A goal of noise that was cut by a smaller one of samples.
        let noise = |spp| RenderSettings { noise: Some(0.01), ..of(spp) };
        let goals = [Goal::of(&noise(40), 0), Goal::of(&noise(4096), 40)];
        assert!(!are_as_one(&goals, &noise(4096), false));
        assert!(are_as_one(&goals[..1], &noise(40), false));
    }
}
