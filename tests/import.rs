//! Every scene file of the shared test data loads or is refused as its manifest says: in time, never by a panic.

use bismar::scene::import::NoteKind;

use crate::helpers::gltf_parts::{LONGEST, attempt, check_scene};
use crate::helpers::shared;

#[test]
fn every_shared_file_loads_or_is_refused_as_its_manifest_says() {
    let Some(folder) = shared::folder() else { return };
    let mut failures = Vec::new();
    let (mut loaded, mut refused, mut rejected, mut either) = (0, 0, 0, 0);
    for row in shared::scenes(&folder) {
        let name = &row["path"];
        let (outcome, time) = attempt(&folder.join(name));
        if time > LONGEST {
            failures.push(format!("{name}: took {time:?}"));
        }
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(panic) => {
                failures.push(format!("{name}: panicked: {panic}"));
                continue;
            }
        };
        if let Err(error) = &outcome
            && !matches!(error.exit_code(), 65 | 66)
        {
            failures.push(format!("{name}: exit code {}: {error}", error.exit_code()));
        }
        if let Ok(imported) = &outcome
            && let Err(broken) = check_scene(imported)
        {
            failures.push(format!("{name}: the scene breaks a promise: {broken}"));
        }
        let must_accept = shared::must_accept(&row["expected_verdict"]);
        match (row["reject_class"].as_str(), outcome) {
            ("must_reject", Ok(imported)) if shared::must_be_noted(name) => {
                // A mesh that nothing places is noted as such.
                let noted = |kind| matches!(kind, NoteKind::Repaired | NoteKind::NotLoaded);
                if !imported.report.notes.iter().any(|note| noted(note.kind)) {
                    failures.push(format!("{name}: loads without a note"));
                }
                loaded += 1;
            }
            ("must_reject", Ok(_)) if must_accept => loaded += 1,
            ("must_reject", Ok(_)) => failures.push(format!("{name}: must be rejected, but loads")),
            ("must_reject", Err(_)) if !must_accept => rejected += 1,
            (_, Ok(_)) if must_accept => loaded += 1,
            // A required extension that we do not have is a reason; nothing else is.
            (_, Err(error)) if must_accept && error.to_string().contains("extensionsRequired:") => refused += 1,
            (_, Err(error)) if must_accept => failures.push(format!("{name}: must load: {error}")),
            _ => either += 1,
        }
    }
    println!("{loaded} load, {refused} refused for a required extension, {rejected} rejected, {either} may do either");
    assert!(failures.is_empty(), "{} failures:\n{}", failures.len(), failures.join("\n"));
    assert!(rejected > 100 && loaded > 150, "the manifest has lost its rows");
}
