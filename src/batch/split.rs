//! Sequences as one job per picture.

use super::frames::Sequence;
use super::job::Job;
use super::views;

/// Splits a sequence into one job per picture; returns other jobs unchanged.
pub fn split(job: &Job) -> Result<Vec<Job>, (String, String)> {
    let one = |&frame: &u32| {
        let mut one = job.numbered(frame, "frames", false)?;
        one.request.selection.frame = Some(frame.into());
        one.request.seed_per_frame.get_or_insert(true);
        Ok(one)
    };
    match &job.sequence {
        None => Ok(vec![job.clone()]),
        Some(Sequence::Frames(frames)) => frames.numbers().iter().map(one).collect(),
        Some(Sequence::Turntable(count)) => views::turntable(job, *count),
        Some(Sequence::Cameras(file)) => views::of_file(job, file),
    }
}
