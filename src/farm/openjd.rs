//! A plan as a job template of the Open Job Description specification (version 2023-09).
//!
//! `{{` and `}}` delimit references in a template and cannot be escaped: in names that contain them, each brace is a reference to
//! a parameter whose value is the brace.

use std::collections::HashSet;

use serde_json::{Value, json};

use super::plan::Plan;
use crate::batch::frames::Frames;
use crate::{Error, Result};

/// The template as JSON. Each render is a step whose tasks are its frames and parts; the merges of a render are a step that
/// depends on it.
/// Errors: [`Error::Usage`] for names and numbers beyond the limits of the format.
pub fn template(plan: &Plan) -> Result<Value> {
    let mut steps = Vec::new();
    let mut names: HashSet<String> = plan.tasks.iter().map(|task| task.render.clone()).collect();
    for tasks in plan.tasks.chunk_by(|a, b| a.render == b.render) {
        let task = &tasks[0];
        let chunks: Vec<_> = tasks.iter().filter(|t| t.part == 1).filter_map(|t| t.frames.as_ref()).collect();
        let parts = plan.parts as usize;
        let mut parameters: Vec<Value> = frames_parameter(&task.render, &chunks)?.into_iter().collect();
        if parts > 1 {
            parameters.push(json!({ "name": "Part", "type": "INT", "range": format!("1-{parts}") }));
        }
        let command = parametrised(&task.command, task.part, parts, &chunks);
        steps.push(step(&task.render, &command, parameters)?);
    }
    for merges in plan.merges.chunk_by(|a, b| a.render == b.render) {
        let merge = &merges[0];
        let chunks: Vec<_> = merges.iter().filter_map(|m| m.frames.as_ref()).collect();
        let parameters = frames_parameter(&merge.render, &chunks)?.into_iter().collect();
        let command = parametrised(&merge.command, 0, 1, &chunks);
        let mut step = step(&merge_name(&mut names, &merge.render), &command, parameters)?;
        step["dependencies"] = json!([{ "dependsOn": step_name(&merge.render)? }]);
        steps.push(step);
    }
    let name = literal(&plan.name);
    if name.chars().count() > MAX_JOB_NAME {
        return Err(Error::Usage(format!(
            "'{}' is longer than {MAX_JOB_NAME} characters, the limit of a job's name: rename the file",
            plan.name
        )));
    }
    let mut template = json!({ "specificationVersion": "jobtemplate-2023-09", "name": name, "steps": steps });
    if template.to_string().contains(BRACES[0].1) || template.to_string().contains(BRACES[1].1) {
        let parameter =
            |(braces, _, name): (&str, &str, &str)| json!({ "name": name, "type": "STRING", "default": braces });
        template["parameterDefinitions"] = BRACES.map(parameter).into();
    }
    Ok(template)
}

/// Largest length of a job's name in characters, with its references.
const MAX_JOB_NAME: usize = 128;

/// Name of the step that merges a render, which is added to the `names` of other steps.
fn merge_name(names: &mut HashSet<String>, render: &str) -> String {
    let mut name = format!("merge {render}");
    while !names.insert(name.clone()) {
        name.insert_str(0, "merge ");
    }
    name
}

fn step(name: &str, command: &[String], parameters: Vec<Value>) -> Result<Value> {
    let mut step = json!({ "name": step_name(name)?, "script": script(command) });
    if !parameters.is_empty() {
        step["parameterSpace"] = json!({ "taskParameterDefinitions": parameters });
    }
    Ok(step)
}

/// Task parameter of the frames: integers if each task has one frame, else strings.
fn frames_parameter(render: &str, chunks: &[&Frames]) -> Result<Option<Value>> {
    /// Largest length of a parameter that is a list.
    const MAX_VALUES: usize = 1024;
    let numbers: Option<Vec<u32>> =
        chunks.iter().map(|c| <[u32; 1]>::try_from(c.numbers()).ok().map(|[n]| n)).collect();
    Ok(match numbers {
        _ if chunks.is_empty() => None,
        Some(numbers) => Some(json!({ "name": "Frame", "type": "INT", "range": Frames::text_of(&numbers, ':') })),
        None if chunks.len() > MAX_VALUES => {
            return Err(Error::Usage(format!(
                "'{render}' is {} chunks of frames, and the format allows {MAX_VALUES}: use a larger --chunk, or 1",
                chunks.len()
            )));
        }
        None => {
            let values: Vec<String> = chunks.iter().map(ToString::to_string).collect();
            Some(json!({ "name": "Frames", "type": "STRING", "range": values }))
        }
    })
}

fn script(command: &[String]) -> Value {
    let mut args = command[1..].to_vec();
    args.insert(1, "--path-mapping={{Session.PathMappingRulesFile}}".into());
    json!({ "actions": { "onRun": {
        "command": command[0],
        "args": args,
        "cancelation": { "mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 30 },
    } } })
}

/// The command of the first part and the first frames, with their numbers replaced by parameters.
fn parametrised(command: &[String], part: u32, of: usize, chunks: &[&Frames]) -> Vec<String> {
    let (number, file) = (format!("--part={part}/"), format!(".{part}-of-{of}.exr"));
    let frames = chunks.first().map(|frames| format!("--frames={frames}"));
    let parameter = if chunks.iter().all(|c| c.numbers().len() == 1) { "Frame" } else { "Frames" };
    let word = |word: &String| {
        if frames.as_ref() == Some(word) {
            format!("--frames={{{{Task.Param.{parameter}}}}}")
        } else if of > 1 && word.starts_with(&number) {
            literal(word).replacen(&number, "--part={{Task.Param.Part}}/", 1)
        } else if of > 1 && word.starts_with("--output=") && word.ends_with(&file) {
            format!("{}.{{{{Task.Param.Part}}}}-of-{of}.exr", literal(&word[..word.len() - file.len()]))
        } else {
            literal(word)
        }
    };
    command.iter().map(word).collect()
}

/// A brace, the reference that yields it, and its parameter.
const BRACES: [(&str, &str, &str); 2] = [("{", "{{Param.L}}", "L"), ("}", "{{Param.R}}", "R")];

/// A name with its braces replaced by references, if two of them stand together.
fn literal(name: &str) -> String {
    if !name.contains("{{") && !name.contains("}}") {
        return name.into();
    }
    let [(_, opened, _), (_, closed, _)] = BRACES;
    let one = |c: char| match c {
        '{' => opened.to_owned(),
        '}' => closed.to_owned(),
        c => c.to_string(),
    };
    name.chars().map(one).collect()
}

fn step_name(name: &str) -> Result<String> {
    const MAX_CHARACTERS: usize = 64;
    match name.chars().count() <= MAX_CHARACTERS {
        true => Ok(name.into()),
        false => Err(Error::Usage(format!(
            "'{name}' is longer than {MAX_CHARACTERS} characters, the limit of a step's name"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::plan::tests::{plan, sequence};

    #[test]
    fn frames_are_a_parameter_space() {
        let of = |plan: &Plan| template(plan).unwrap();
        let single = of(&sequence(2, 1));
        let space = |step: usize| single["steps"][step]["parameterSpace"]["taskParameterDefinitions"].clone();
        assert_eq!(single["steps"].as_array().map(Vec::len), Some(2));
        assert_eq!(space(0)[0], json!({ "name": "Frame", "type": "INT", "range": "1-7" }));
        assert_eq!((&space(0)[1]["range"], space(1).as_array().map(Vec::len)), (&json!("1-2"), Some(1)));
        let args = single["steps"][1]["script"]["actions"]["onRun"]["args"].to_string();
        assert!(args.contains("--frames={{Task.Param.Frame}}") && args.contains("a.####.2-of-2.exr"), "{args}");
        let chunked = of(&sequence(1, 3));
        assert_eq!(
            chunked["steps"][0]["parameterSpace"]["taskParameterDefinitions"],
            json!([{ "name": "Frames", "type": "STRING", "range": ["1-3", "4-6", "7"] }])
        );
    }

    #[test]
    fn braces_in_names_are_references_that_do_not_touch_braces() {
        for (name, right) in [
            ("x{a}", "x{a}"),
            ("x{}}", "x{{Param.L}}{{Param.R}}{{Param.R}}"),
            ("{{{", "{{Param.L}}{{Param.L}}{{Param.L}}"),
        ] {
            assert_eq!(literal(name), right);
        }
    }

    #[test]
    fn a_render_that_is_called_like_a_merge_is_a_step_of_its_own() {
        let mut plan = plan(2);
        plan.tasks.iter_mut().filter(|task| task.render == "b").for_each(|task| task.render = "merge a".into());
        plan.merges[1].render = "merge a".into();
        let template = template(&plan).unwrap();
        let names: Vec<_> = (0..4).map(|i| template["steps"][i]["name"].as_str().unwrap()).collect();
        assert_eq!(names, ["a", "merge a", "merge merge a", "merge merge merge a"]);
        assert_eq!(template["steps"][3]["dependencies"][0]["dependsOn"], "merge a");
    }

    #[test]
    fn a_name_that_is_too_long_is_refused_here() {
        let long = |n: usize| {
            let mut named = plan(1);
            named.name = "é".repeat(n);
            template(&named)
        };
        assert!(long(128).is_ok());
        let refused = long(129).unwrap_err();
        assert!(refused.exit_code() == 64 && refused.to_string().contains("128 characters"), "{refused}");
    }

    #[test]
    fn parts_are_a_parameter_and_merges_depend() {
        let template = template(&plan(3)).unwrap();
        assert_eq!(template["steps"].as_array().map(Vec::len), Some(4));
        let step = &template["steps"][1];
        assert_eq!(step["parameterSpace"]["taskParameterDefinitions"][0]["range"], "1-3");
        let args = step["script"]["actions"]["onRun"]["args"].to_string();
        assert!(args.contains("--part={{Task.Param.Part}}/3"), "{args}");
        assert!(args.contains("/f/parts/b.{{Task.Param.Part}}-of-3.exr"), "{args}");
        assert_eq!(template["steps"][3]["dependencies"][0]["dependsOn"], "b");
    }
}
