//! Progress bars in the last lines of a terminal. Messages go above them, and Ctrl-C leaves no bar behind.

use std::io::{self, IsTerminal, Write};
use std::sync::LazyLock;
use std::time::Duration;

use console::Term;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};

/// All bars of the process. None is drawn if stderr is not a terminal.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    let term = Term::stderr();
    MultiProgress::with_draw_target(match term.is_term() {
        true => ProgressDrawTarget::term_like_with_hz(Box::new(Narrow(term)), 10),
        false => ProgressDrawTarget::hidden(),
    })
});

/// Adds a bar with this number of steps below the others. `template` is indicatif's, for example `{wide_bar} {msg}`.
pub fn bar(steps: u64, template: &str) -> ProgressBar {
    let bar = BARS.add(ProgressBar::new(steps));
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

pub fn remove(bar: &ProgressBar) {
    bar.finish_and_clear();
    BARS.remove(bar);
}

/// Removes all bars for the rest of the process.
pub fn clear() {
    if !io::stderr().is_terminal() {
        return;
    }
    let _ = BARS.clear();
    BARS.set_draw_target(ProgressDrawTarget::hidden());
}

/// Writes to stderr above the bars and waits for the reader. Errors are ignored.
pub(super) fn write_now(bytes: &[u8]) {
    let write = || drop(io::stderr().lock().write_all(bytes));
    match io::stderr().is_terminal() {
        true => BARS.suspend(write),
        false => write(),
    }
}

/// A duration as `4:02` or `1:23:45`; `?` if it is not finite.
pub fn clock(seconds: f64) -> String {
    let Ok(whole) = Duration::try_from_secs_f64(seconds.round()) else { return "?".into() };
    let (hours, minutes, seconds) = (whole.as_secs() / 3600, whole.as_secs() / 60 % 60, whole.as_secs() % 60);
    match hours {
        0 => format!("{minutes}:{seconds:02}"),
        1..=999 => format!("{hours}:{minutes:02}:{seconds:02}"),
        _ => format!("{} days", hours / 24),
    }
}

/// A terminal whose last columns stay empty. The cursor rests there, so that the `^C` that a terminal echoes stays in the
/// bar's line and is removed with it. Errors of the terminal are ignored.
#[derive(Debug)]
struct Narrow(Term);

/// Columns that stay empty.
const EMPTY_COLUMNS: u16 = 4;

impl TermLike for Narrow {
    fn width(&self) -> u16 {
        self.0.size().1.saturating_sub(EMPTY_COLUMNS).max(20)
    }

    fn height(&self) -> u16 {
        self.0.size().0
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_up(n).or(Ok(()))
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_down(n).or(Ok(()))
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_right(n).or(Ok(()))
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.0.move_cursor_left(n).or(Ok(()))
    }

    fn write_line(&self, s: &str) -> io::Result<()> {
        self.0.write_line(s).or(Ok(()))
    }

    fn write_str(&self, s: &str) -> io::Result<()> {
        self.0.write_str(s).or(Ok(()))
    }

    fn clear_line(&self) -> io::Result<()> {
        self.0.clear_line().or(Ok(()))
    }

    fn flush(&self) -> io::Result<()> {
        self.0.flush().or(Ok(()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clocks_are_short() {
        let shown = [0.0, 59.6, 242.0, 5025.0, 4e6, f64::INFINITY, f64::NAN].map(clock);
        assert_eq!(shown, ["0:00", "1:00", "4:02", "1:23:45", "46 days", "?", "?"]);
    }
}
