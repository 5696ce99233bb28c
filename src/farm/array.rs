//! The number of this process among the tasks of an array, as schedulers tell it in environment variables.

use std::env;

struct Scheduler {
    index: &'static str,
    /// The index of the first task.
    first: u32,
    /// The number of tasks, if the scheduler tells it.
    count: Option<&'static str>,
    /// The largest index, if the scheduler tells it. It differs from the count if not all tasks were started.
    last: Option<&'static str>,
}

/// In the order in which they are asked.
const SCHEDULERS: [Scheduler; 3] = [
    // Arrays of other numbers than 1 to N are refused.
    Scheduler {
        index: "SLURM_ARRAY_TASK_ID",
        first: 1,
        count: Some("SLURM_ARRAY_TASK_COUNT"),
        last: Some("SLURM_ARRAY_TASK_MAX"),
    },
    Scheduler { index: "AWS_BATCH_JOB_ARRAY_INDEX", first: 0, count: Some("AWS_BATCH_JOB_ARRAY_SIZE"), last: None },
    // Kubernetes, of a Job whose completionMode is Indexed.
    Scheduler { index: "JOB_COMPLETION_INDEX", first: 0, count: None, last: None },
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArrayTask {
    /// Its number, from 1.
    pub number: u32,
    /// Number of tasks, if the scheduler tells it.
    pub of: Option<u32>,
}

/// The task of an array that this process is.
pub(crate) fn array_task() -> Result<ArrayTask, String> {
    of_variables(&|name| env::var(name).ok().filter(|value| !value.trim().is_empty()))
}

fn of_variables(variable: &dyn Fn(&str) -> Option<String>) -> Result<ArrayTask, String> {
    let number = |name: &str| {
        let Some(text) = variable(name) else { return Ok(None) };
        text.trim().parse::<u32>().map(Some).map_err(|_| format!("{name} is '{text}', not a number"))
    };
    for Scheduler { index, first, count, last } in &SCHEDULERS {
        let Some(found) = number(index)? else { continue };
        if found < *first {
            return Err(format!("{index} is {found}: the array's tasks must have the numbers 1 to N (--array=1-N)"));
        }
        let asked = |name: &Option<&str>| name.map_or(Ok(None), number);
        let (count, last) = (asked(count)?, asked(last)?);
        // A part of an array that is started again does not tell the number of all.
        let of = count.filter(|count| last.is_none_or(|last| last == *count));
        return Ok(ArrayTask { number: (found - first).saturating_add(1), of });
    }
    let names = SCHEDULERS.map(|scheduler| scheduler.index).join(", ");
    Err(format!("this is no task of an array: none of {names} is set"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scheduler_tells_the_number_of_its_task() {
        let of = |variables: &[(&str, &str)]| {
            of_variables(&|name| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
        };
        let slurm = |id, count, max| {
            of(&[("SLURM_ARRAY_TASK_ID", id), ("SLURM_ARRAY_TASK_COUNT", count), ("SLURM_ARRAY_TASK_MAX", max)])
        };
        assert_eq!(slurm("3", "8", "8"), Ok(ArrayTask { number: 3, of: Some(8) }));
        // Task 3 alone, started again: of how many is not known.
        assert_eq!(slurm("3", "1", "3"), Ok(ArrayTask { number: 3, of: None }));
        assert!(slurm("0", "8", "7").unwrap_err().contains("1 to N"));
        let aws = of(&[("AWS_BATCH_JOB_ARRAY_INDEX", "0"), ("AWS_BATCH_JOB_ARRAY_SIZE", "4")]);
        assert_eq!(aws, Ok(ArrayTask { number: 1, of: Some(4) }));
        assert_eq!(of(&[("JOB_COMPLETION_INDEX", "7")]), Ok(ArrayTask { number: 8, of: None }));
        assert!(of(&[("JOB_COMPLETION_INDEX", "-1")]).unwrap_err().contains("JOB_COMPLETION_INDEX is '-1'"));
        assert!(of(&[]).unwrap_err().contains("none of SLURM_ARRAY_TASK_ID"));
    }
}
