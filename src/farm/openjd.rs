//! A plan as a job template of the Open Job Description specification (version 2023-09).
//!
//! Two braces begin and end a reference there, and nothing escapes them: names that hold them refer to parameters whose
//! values are braces.

use serde_json::{Value, json};

use super::Plan;
use crate::{Error, Result};

/// The template, as JSON. Each render is a step whose tasks are its parts, each merge a step that depends on it.
///
/// # Errors
/// [`Error::Usage`] for names that the format has no place for.
pub fn template(plan: &Plan) -> Result<Value> {
    let mut steps = Vec::new();
    let mut first = 0;
    while let Some(task) = plan.tasks.get(first) {
        let own = plan.tasks[first..].iter().take_while(|t| t.render == task.render).count();
        let mut step = json!({
            "name": step_name(&task.render)?,
            "script": script(&parametrised(&plan.tasks[first].command, task.part, own)),
        });
        if own > 1 {
            let part = json!({ "name": "Part", "type": "INT", "range": format!("1-{own}") });
            step["parameterSpace"] = json!({ "taskParameterDefinitions": [part] });
        }
        steps.push(step);
        first += own;
    }
    for merge in &plan.merges {
        steps.push(json!({
            "name": step_name(&format!("merge {}", merge.render))?,
            "dependencies": [{ "dependsOn": step_name(&merge.render)? }],
            "script": script(&parametrised(&merge.command, 0, 1)),
        }));
    }
    let name = literal(&plan.name);
    let mut template = json!({ "specificationVersion": "jobtemplate-2023-09", "name": name, "steps": steps });
    if template.to_string().contains(BRACES[0].1) || template.to_string().contains(BRACES[1].1) {
        let parameter =
            |(braces, _, name): (&str, &str, &str)| json!({ "name": name, "type": "STRING", "default": braces });
        template["parameterDefinitions"] = BRACES.map(parameter).into();
    }
    Ok(template)
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

/// The first part's command as that of all.
fn parametrised(command: &[String], part: u32, of: usize) -> Vec<String> {
    if of == 1 {
        return command.iter().map(|word| literal(word)).collect();
    }
    let (number, file) = (format!("--part={part}/"), format!(".{part}-of-{of}.exr"));
    let word = |word: &String| {
        if word.starts_with(&number) {
            literal(word).replacen(&number, "--part={{Task.Param.Part}}/", 1)
        } else if word.starts_with("--output=") && word.ends_with(&file) {
            format!("{}.{{{{Task.Param.Part}}}}-of-{of}.exr", literal(&word[..word.len() - file.len()]))
        } else {
            literal(word)
        }
    };
    command.iter().map(word).collect()
}

/// Braces, what refers to them, and the parameter's name.
const BRACES: [(&str, &str, &str); 2] = [("{{", "{{Param.Open}}", "Open"), ("}}", "{{Param.Close}}", "Close")];

/// What stands for a name where references are allowed.
fn literal(name: &str) -> String {
    let [(open, opened, _), (close, closed, _)] = BRACES;
    // The references end with braces of their own.
    name.split(open).map(|part| part.replace(close, closed)).collect::<Vec<_>>().join(opened)
}

fn step_name(name: &str) -> Result<String> {
    const LONGEST: usize = 64;
    match name.chars().count() <= LONGEST {
        true => Ok(name.into()),
        false => {
            Err(Error::Usage(format!("'{name}' is longer than the {LONGEST} letters that a step's name may have")))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::farm::tests::plan;

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
