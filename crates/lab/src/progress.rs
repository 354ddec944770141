//! How long computations tell whoever runs them how far they are.

/// Something a long computation has to tell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// A stage of this many steps begins.
    Begin {
        /// What it does, for example `train`.
        stage: &'a str,
        /// Its number of steps.
        steps: u64,
    },
    /// This many more steps are done.
    Advance(u64),
    /// A word on how it goes, to stand beside the bar.
    Note(&'a str),
    /// The stage is over.
    End,
}

/// Hands events to a listener, from any thread.
#[derive(Clone, Copy)]
pub struct Progress<'a> {
    listener: &'a (dyn Fn(Event<'_>) + Sync),
}

impl std::fmt::Debug for Progress<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Progress")
    }
}

impl<'a> Progress<'a> {
    /// Progress that `listener` hears of.
    pub fn new(listener: &'a (dyn Fn(Event<'_>) + Sync)) -> Self {
        Self { listener }
    }

    /// Progress that nobody hears of.
    pub fn silent() -> Progress<'static> {
        Progress { listener: &|_| () }
    }

    /// Runs a stage of `steps` steps.
    pub fn stage<T>(&self, stage: &str, steps: u64, run: impl FnOnce(&Self) -> T) -> T {
        (self.listener)(Event::Begin { stage, steps });
        let result = run(self);
        (self.listener)(Event::End);
        result
    }

    /// This many more steps are done.
    pub fn advance(&self, steps: u64) {
        (self.listener)(Event::Advance(steps));
    }

    /// A word on how it goes.
    pub fn note(&self, text: &str) {
        (self.listener)(Event::Note(text));
    }
}
