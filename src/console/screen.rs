//! The terminal's last lines, where bars are: what is said goes above them, and a Ctrl-C leaves nothing behind.

use std::io::{self, Write};
use std::sync::LazyLock;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use console::{Term, measure_text_width};
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle, TermLike};

/// All bars of the process; none is drawn where stderr is no terminal.
static BARS: LazyLock<MultiProgress> = LazyLock::new(|| {
    let term = Term::stderr();
    MultiProgress::with_draw_target(match term.is_term() {
        true => ProgressDrawTarget::term_like_with_hz(Box::new(Narrow { term, column: AtomicUsize::new(0) }), 10),
        false => ProgressDrawTarget::hidden(),
    })
});

/// Adds a bar of so many steps below those that are there. `template` is indicatif's, as in `{wide_bar} {msg}`.
pub fn bar(steps: u64, template: &str) -> ProgressBar {
    let bar = BARS.add(ProgressBar::new(steps));
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar
}

/// Takes a bar away.
pub fn remove(bar: &ProgressBar) {
    bar.finish_and_clear();
    BARS.remove(bar);
}

/// Takes all bars away, for good.
pub fn clear() {
    let _ = BARS.clear();
    BARS.set_draw_target(ProgressDrawTarget::hidden());
}

/// Writes to stderr above the bars. Nobody there to read it is no error.
pub fn write(bytes: &[u8]) {
    BARS.suspend(|| {
        let _ = io::stderr().lock().write_all(bytes);
    });
}

/// For those who want a writer: all of a call's bytes go above the bars.
pub struct Above;

impl Write for Above {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        write(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Minutes and seconds, as in `4:02` or `1:23:45`; `?` for what nobody knows.
pub fn clock(seconds: f64) -> String {
    let Ok(whole) = Duration::try_from_secs_f64(seconds.round()) else { return "?".into() };
    let (hours, minutes, seconds) = (whole.as_secs() / 3600, whole.as_secs() / 60 % 60, whole.as_secs() % 60);
    match hours {
        0 => format!("{minutes}:{seconds:02}"),
        1..=999 => format!("{hours}:{minutes:02}:{seconds:02}"),
        _ => format!("{} days", hours / 24),
    }
}

/// A terminal with its last columns left empty, if it has 80 at least. The cursor waits there: the `^C` that a terminal
/// prints when somebody types it stays in the bar's line and goes away with it. indicatif fills lines up to their end and
/// takes it that the next one begins by itself: here it has to be begun. Bars are no reason to fail: errors of the
/// terminal are dropped.
#[derive(Debug)]
struct Narrow {
    term: Term,
    /// Columns written in this line.
    column: AtomicUsize,
}

const SPARE: u16 = 4;

impl Narrow {
    fn at_start(&self, done: io::Result<()>) -> io::Result<()> {
        self.column.store(0, Ordering::Relaxed);
        done.or(Ok(()))
    }
}

impl TermLike for Narrow {
    fn width(&self) -> u16 {
        let columns = self.term.size().1;
        if columns < 80 { columns.max(1) } else { columns - SPARE }
    }

    fn height(&self) -> u16 {
        self.term.size().0
    }

    fn move_cursor_up(&self, n: usize) -> io::Result<()> {
        self.at_start(self.term.move_cursor_up(n))
    }

    fn move_cursor_down(&self, n: usize) -> io::Result<()> {
        self.at_start(self.term.move_cursor_down(n))
    }

    fn move_cursor_right(&self, n: usize) -> io::Result<()> {
        self.term.move_cursor_right(n).or(Ok(()))
    }

    fn move_cursor_left(&self, n: usize) -> io::Result<()> {
        self.term.move_cursor_left(n).or(Ok(()))
    }

    fn write_line(&self, text: &str) -> io::Result<()> {
        self.at_start(self.term.write_line(text))
    }

    fn write_str(&self, text: &str) -> io::Result<()> {
        let before = self.column.load(Ordering::Relaxed);
        if before > 0 && before.is_multiple_of(self.width().into()) && !text.is_empty() {
            self.write_line("")?;
        }
        self.column.fetch_add(measure_text_width(text), Ordering::Relaxed);
        self.term.write_str(text).or(Ok(()))
    }

    fn clear_line(&self) -> io::Result<()> {
        self.at_start(self.term.clear_line())
    }

    fn flush(&self) -> io::Result<()> {
        self.term.flush().or(Ok(()))
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
