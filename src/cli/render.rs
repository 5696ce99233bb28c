//! `bismar render SCENE`

mod args;
mod replay;
mod values;

use std::ffi::OsString;
use std::io::stdin;
use std::path::Path;
use std::time::Instant;

use clap::{Args, Command, FromArgMatches};
use tracing::info;

pub use args::RenderArgs;

use super::options::{Options, parse};
use crate::Result;
use crate::console::{Paths, Reporter, Signals, Verbosity, Verdict, host, progress, say};
use crate::film::atomic;
use crate::job::{Inputs, Loaded, RenderRequest, Session, memory};

/// The flags of `bismar render`.
pub fn command() -> Command {
    RenderArgs::augment_args(Command::new("render"))
}

/// Reads a line of flags, the first word being the command's name, with [`command`].
pub fn read(
    command: &Command,
    line: impl IntoIterator<Item = OsString>,
) -> std::result::Result<RenderArgs, clap::Error> {
    RenderArgs::from_arg_matches(&command.clone().try_get_matches_from(line)?)
}

/// The request by options: names of flags without dashes, and their values.
/// Errors: [`Error::Usage`](crate::Error::Usage).
pub fn request(scene: &Path, options: &Options) -> Result<RenderRequest> {
    parse::<RenderArgs>("render", options, &[scene])?.request()
}

pub fn run(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let result = render(args, verbosity);
    result.inspect_err(|error| progress::failed(args.progress, error))
}

fn render(args: &RenderArgs, verbosity: Verbosity) -> Result<Verdict> {
    let began = Instant::now();
    args.check()?;
    let mut args = args.on_this_machine()?;
    let from_pipe = args.takes_standard_input();
    let request = args.request()?;
    let (threads, source) = host::threads(request.threads)?;
    if let Some(pixel_path) = args.replay_pixel {
        return host::pool(threads)?.install(|| replay::run(&request, pixel_path));
    }
    let mut paths = Paths::default();
    // A name that the part's number completes is not the command line's.
    if !args.part_flag.is_some_and(|flag| flag.is_auto) {
        [&args.output, &request.preview, &request.stats].into_iter().flatten().for_each(|path| atomic::named(path));
    }
    atomic::confine(&[]);
    args.path_mapping.iter().try_for_each(|path| paths.reads("--path-mapping", path))?;
    request.declare("", &mut paths)?;
    // Before any file is touched.
    let signals = if args.signals_from_parent { Signals::from_parent() } else { Signals::listen() }?;
    let _claims = request.claim_outputs()?;
    info!("{threads} threads ({source})");
    host::pool(threads)?.install(|| {
        let reporter = Reporter::new(args.progress, verbosity.quiet);
        let prepared = signals.nothing_to_save(|| {
            let inputs =
                if from_pipe { Inputs::read_pipe(&request, &mut stdin().lock()) } else { Inputs::read(&request) }?;
            inputs.declare(&mut paths)?;
            let session = Session { request: &request, inputs: &inputs, threads, began, replaces: false };
            if let Some(earlier) = session.finished_before()? {
                return Ok(Err(session.develop(&earlier)?));
            }
            memory::hold(session.check_memory()?);
            // A signal ends the process here, so the build need not stop by itself.
            let loaded = Loaded::load(&request, &inputs, &|done, seconds| {
                reporter.building(done, seconds);
                true
            });
            Ok(Ok((loaded.inspect_err(|_| reporter.finish(false))?, inputs)))
        });
        let done = match prepared? {
            Ok((loaded, inputs)) => {
                let session = Session { request: &request, inputs: &inputs, threads, began, replaces: false };
                let ends = |complete| reporter.finish(complete);
                session.render(&loaded, &signals.stop, &|p| reporter.update(p), &ends)?
            }
            Err(done) => done,
        };
        if !verbosity.quiet {
            say(done);
        }
        Ok(Verdict::Done)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_by_default_is_the_command_without_flags() {
        let plain = request(Path::new("a.glb"), &Options::new()).unwrap();
        let default = RenderRequest { scene: "a.glb".into(), output: "a.exr".into(), ..RenderRequest::default() };
        assert_eq!(format!("{plain:#?}"), format!("{default:#?}"));
    }
}
