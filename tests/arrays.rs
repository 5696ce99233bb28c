//! Arrays of schedulers that start many processes with one command: Slurm, AWS Batch, Kubernetes.

use std::path::Path;

use crate::helpers::program::{Folder, assert_same_bits, bismar, expect, names, says, stderr};

/// The variables that a scheduler gives to task `k` (from 1) of `n`.
fn variables(scheduler: &str, k: u32, n: u32) -> Vec<(&'static str, String)> {
    match scheduler {
        "slurm" => vec![
            ("SLURM_ARRAY_TASK_ID", k.to_string()),
            ("SLURM_ARRAY_TASK_COUNT", n.to_string()),
            ("SLURM_ARRAY_TASK_MAX", n.to_string()),
        ],
        "aws" => {
            vec![("AWS_BATCH_JOB_ARRAY_INDEX", (k - 1).to_string()), ("AWS_BATCH_JOB_ARRAY_SIZE", n.to_string())]
        }
        _ => vec![("JOB_COMPLETION_INDEX", (k - 1).to_string())],
    }
}

/// Runs `bismar LINE` as task `k` of `n`; returns exit code and stderr.
fn task(folder: &Path, scheduler: &str, (k, n): (u32, u32), line: &str) -> (i32, String) {
    let output = bismar(folder).envs(variables(scheduler, k, n)).args(line.split_whitespace()).output().unwrap();
    (output.status.code().unwrap(), stderr(&output))
}

#[test]
fn one_command_renders_every_part_and_they_merge_to_the_whole() {
    let path = &Folder::new().with_scene("c.glb", "cornell.glb");
    let line = "render c.glb --size 64x48 --spp 4 -q";
    expect(path, &format!("{line} -o whole.exr"), 0);
    for (scheduler, flag) in [("slurm", "auto"), ("aws", "auto"), ("kubernetes", "auto/3")] {
        for k in 1..=3 {
            let line = format!("{line} --part {flag} -o {scheduler}.##.exr --stats {scheduler}.{{frame}}.json");
            assert_eq!(task(path, scheduler, (k, 3), &line), (0, String::new()));
        }
        let parts = (1..=3).map(|k| format!("{scheduler}.0{k}.exr")).collect::<Vec<_>>().join(" ");
        expect(path, &format!("merge {parts} -o merged.exr -q"), 0);
        assert_same_bits(&path.join("merged.exr"), &path.join("whole.exr"));
        assert!(path.join(format!("{scheduler}.3.json")).exists());
    }
    for (scheduler, flags, why) in [
        ("kubernetes", "--part auto", "auto/N"),
        ("kubernetes", "--part auto/3 -o one.exr", "one file for all parts"),
        ("kubernetes", "--part auto/1", "task 2 of the array, but there are 1 parts"),
        ("kubernetes", "--part auto/3 --turntable 4", "one picture"),
    ] {
        let (code, said) = task(path, scheduler, (2, 3), &format!("{line} {flags}"));
        assert!(code == 64 && said.contains(why), "{flags}: {code} {said}");
    }
    says(path, "render c.glb --part auto/2", 64, "no task of an array");
}

#[test]
fn a_plan_without_a_scheduler_is_rendered_and_merged_by_arrays() {
    let path = &Folder::new().with_scene("c.glb", "cornell.glb");
    let flags = "--size 64x48 --spp 4";
    expect(path, &format!("render c.glb {flags} -o whole.exr -q"), 0);
    let said = expect(path, &format!("farm submit c.glb --parts 2 --format plan -- {flags} -o out.exr"), 0);
    assert!(said.contains("2 tasks: bismar farm task auto") && said.contains("then 1 merges"), "{said}");
    assert_eq!(names(&path.join("c.farm")), ["farm.json", "logs", "parts"]);
    for (merges, tasks) in [("", 2), ("--merge", 1)] {
        for k in 1..=tasks {
            let (code, said) =
                task(path, "kubernetes", (k, tasks), &format!("farm task auto {merges} --plan c.farm/farm.json"));
            assert_eq!(code, 0, "{said}");
        }
    }
    assert_same_bits(&path.join("out.exr"), &path.join("whole.exr"));
    let (code, _) = task(path, "kubernetes", (9, 9), "farm task auto --plan c.farm/farm.json");
    assert_ne!(code, 0);
}
