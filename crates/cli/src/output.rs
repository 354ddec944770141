//! Where words go: results to standard output, everything about the way there to standard error.

use std::io::{self, Write as _};
use std::sync::{Mutex, PoisonError};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use lanecraft_lab::progress::{Event, Progress};

/// Prints as much as was asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Output {
    quiet: bool,
}

impl Output {
    pub(crate) fn new(quiet: bool) -> Self {
        Self { quiet }
    }

    /// A remark on the way.
    pub(crate) fn note(self, text: &str) {
        if !self.quiet {
            complain(text);
        }
    }

    /// Runs `job` with progress that is drawn as a bar for each stage, on standard error and only on a terminal.
    pub(crate) fn with_progress<T>(self, job: impl FnOnce(&Progress) -> T) -> T {
        let bar = Mutex::new(self.bar(0, ""));
        let listener = |event: Event<'_>| {
            let mut bar = bar.lock().unwrap_or_else(PoisonError::into_inner);
            match event {
                Event::Begin { stage, steps } => *bar = self.bar(steps, stage),
                Event::Advance(steps) => bar.inc(steps),
                Event::Note(text) => bar.set_message(text.to_owned()),
                Event::End => bar.finish(),
            }
        };
        job(&Progress::new(&listener))
    }

    fn bar(self, steps: u64, stage: &str) -> ProgressBar {
        let target = if self.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let template = format!("{stage:>9} {{bar:24}} {{human_pos}}/{{human_len}}, {{eta}} left  {{wide_msg}}");
        let style = ProgressStyle::with_template(&template).expect("the template is well formed");
        ProgressBar::with_draw_target(Some(steps), target).with_style(style)
    }
}

/// A line of the result on standard output, printed even if quiet.
pub(crate) fn answer(text: &str) -> io::Result<()> {
    writeln!(io::stdout().lock(), "{text}")
}

/// A line on standard error; if that is closed, nobody is there to be told.
pub(crate) fn complain(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

#[cfg(test)]
mod tests {
    use super::Output;

    #[test]
    fn a_quiet_bar_is_hidden_and_counts() {
        let bar = Output::new(true).bar(10, "train");
        bar.set_position(4);
        assert!(bar.is_hidden());
        assert_eq!((bar.position(), bar.length()), (4, Some(10)));
    }
}
