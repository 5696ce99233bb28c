//! Denoising in a process of its own: a library that aborts, or that takes too much memory, ends that process alone.

use std::io::{self, Read, Write};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use rustix::process::{Signal, set_parent_process_death_signal};

use crate::console::child::this_program;
use crate::console::signals::HEARD;
use crate::film::denoise::{Denoiser, NoisyPicture};
use crate::{Error, Result};

/// Denoises a picture of so many pixels in a process of its own: reads radiance, albedo and normals from standard input
/// (32-bit floats, little-endian) and writes the denoised radiance.
///
/// # Errors
/// Those of the denoiser, and of standard input and output.
pub fn work(width: usize, height: usize) -> Result<()> {
    // Nobody else wants what it makes.
    let _ = set_parent_process_death_signal(Some(Signal::KILL));
    let pixels = width.checked_mul(height).ok_or_else(|| Error::Usage("too many pixels".into()))?;
    let failed = |e: io::Error| Error::Io(format!("a pipe of `bismar render`: {e}"));
    let mut picture = NoisyPicture { width, ..Default::default() };
    let mut input = io::stdin().lock();
    for image in &mut picture.images {
        *image = read_image(&mut input, pixels).map_err(failed)?;
    }
    let denoised = Denoiser::load()?.denoise(&picture)?;
    let mut output = io::stdout().lock();
    write_image(&mut output, &denoised).and_then(|()| output.flush()).map_err(failed)?;
    Ok(())
}

fn write_image(to: &mut impl Write, image: &[[f32; 3]]) -> io::Result<()> {
    for some in image.chunks(4096) {
        let bytes: Vec<u8> = some.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        to.write_all(&bytes)?;
    }
    Ok(())
}

fn read_image(from: &mut impl Read, pixels: usize) -> io::Result<Vec<[f32; 3]>> {
    let mut image = vec![[0.0; 3]; pixels];
    let mut bytes = [0; 4096 * 12];
    for some in image.chunks_mut(4096) {
        let bytes = &mut bytes[..some.len() * 12];
        from.read_exact(bytes)?;
        for (x, bytes) in some.iter_mut().flatten().zip(bytes.as_chunks::<4>().0) {
            *x = f32::from_le_bytes(*bytes);
        }
    }
    Ok(image)
}

/// Denoises a picture in a child process, which is killed when `stop` is raised.
/// Errors: [`Error::Interrupted`] when `stop` was raised; [`Error::Host`] for a denoiser that fails, aborts or is killed.
pub(crate) fn denoised_elsewhere(picture: &NoisyPicture, stop: &AtomicBool) -> Result<Vec<[f32; 3]>> {
    let pixels = picture.images[0].len();
    let (width, height) = (picture.width, pixels / picture.width.max(1));
    let cannot = |what: &str, e: io::Error| Error::Host(format!("--denoise oidn: cannot {what} its process: {e}"));
    let mut command = this_program();
    command.args(["denoise-worker", &width.to_string(), &height.to_string()]);
    let child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = child.map_err(|e| cannot("start", e))?;
    let (input, output, errors) = (child.stdin.take(), child.stdout.take(), child.stderr.take());
    thread::scope(|scope| {
        scope.spawn(|| {
            // Errors are those of a child that has ended, whose status says more.
            let _ = input.map(|mut to| picture.images.iter().try_for_each(|image| write_image(&mut to, image)));
        });
        let result = scope.spawn(|| read_image(&mut output.ok_or(io::ErrorKind::BrokenPipe)?, pixels));
        let said = scope.spawn(|| {
            let mut text = Vec::new();
            let _ = errors.map(|mut errors| errors.read_to_end(&mut text));
            String::from_utf8_lossy(&text).trim().to_owned()
        });
        let status = wait(&mut child, stop).map_err(|e| cannot("wait for", e))?;
        let (result, said) = (result.join(), said.join().unwrap_or_default());
        if stop.load(Ordering::SeqCst) || status.signal().is_some_and(|signal| HEARD.contains(&signal)) {
            return Err(Error::Interrupted("interrupted while denoising".into()));
        }
        match result {
            Ok(Ok(image)) if status.success() => Ok(image),
            _ => Err(Error::Host(failure(status, &said))),
        }
    })
}

/// What went wrong in the child: its own words, after the signal that ended it, if one did.
fn failure(status: ExitStatus, said: &str) -> String {
    let said = said.strip_prefix("error: ").unwrap_or(said);
    match status.signal() {
        Some(signal) if said.is_empty() => format!("--denoise oidn: its process was ended by signal {signal}"),
        Some(signal) => format!("--denoise oidn: its process was ended by signal {signal}: {said}"),
        None if said.is_empty() => format!("--denoise oidn: its process ended early, with {status}"),
        None => said.to_owned(),
    }
}

/// Waits for the child, and kills it when `stop` is raised.
fn wait(child: &mut Child, stop: &AtomicBool) -> io::Result<ExitStatus> {
    let mut pause = Duration::from_millis(1);
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if stop.load(Ordering::SeqCst) {
            child.kill()?;
            return child.wait();
        }
        thread::sleep(pause);
        pause = (2 * pause).min(Duration::from_millis(30));
    }
}
