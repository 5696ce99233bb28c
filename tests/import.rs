//! Every scene file of the shared test data loads or is refused as its manifest says: in time, never by a panic.

mod gltf_parts;

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use gltf_parts::{LONGEST, attempt, check_scene};

/// The shared glTF files, or `None` with a word about it. On CI they must be there.
fn shared() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/gltf");
    if folder.join("manifest.csv").exists() {
        return Some(folder);
    }
    assert!(std::env::var("CI").as_deref() != Ok("true"), "{} is missing", folder.display());
    println!("skipped: {} is missing", folder.display());
    None
}

/// Rows of a CSV text with quoted fields, by column name.
fn rows(text: &str) -> Vec<HashMap<String, String>> {
    let mut lines = text.lines().map(|line| {
        let (mut fields, mut quoted) = (vec![String::new()], false);
        for c in line.chars() {
            match c {
                '"' => quoted = !quoted,
                ',' if !quoted => fields.push(String::new()),
                c => fields.last_mut().unwrap().push(c),
            }
        }
        fields
    });
    let names = lines.next().unwrap();
    lines.map(|fields| names.iter().cloned().zip(fields).collect()).collect()
}

#[test]
fn every_shared_file_loads_or_is_refused_as_its_manifest_says() {
    let Some(folder) = shared() else { return };
    let text = std::fs::read_to_string(folder.join("manifest.csv")).unwrap();
    let mut failures = Vec::new();
    let (mut loaded, mut refused, mut rejected, mut either) = (0, 0, 0, 0);
    for row in rows(&text) {
        let name = &row["path"];
        if !name.ends_with(".gltf") && !name.ends_with(".glb") {
            continue;
        }
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
        let verdict = row["expected_verdict"].as_str();
        let must_accept =
            verdict.starts_with("accept") && !verdict.contains("or error") && !verdict.contains("or clear error");
        match (row["reject_class"].as_str(), outcome) {
            ("must_reject", Ok(_)) => failures.push(format!("{name}: must be rejected, but loads")),
            ("must_reject", Err(_)) => rejected += 1,
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
