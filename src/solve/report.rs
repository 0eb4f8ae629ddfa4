//! What a search is told, and what it tells.

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Linearisations at most.
    pub iterations: usize,
    /// A step smaller than this in every unknown, counted in the unknown's unit (1 mm, 1 mrad, 1 px), ends the search.
    pub step: f64,
    /// A relative decrease of the cost below this, predicted and found, ends the search.
    pub decrease: f64,
    /// First damping, relative to the diagonal.
    pub damping: f64,
    /// About how many corners a first search looks at, where there are several times as many and nothing but robots moves; none makes no such search.
    pub thinned: Option<usize>,
}

impl Default for Options {
    fn default() -> Self {
        Self { iterations: 100, step: 1e-7, decrease: 1e-12, damping: 1e-5, thinned: Some(24_000) }
    }
}

/// Why the search ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Termination {
    /// The last step was too small to matter.
    SmallStep,
    /// The cost no longer changes.
    CostUnchanged,
    /// There is nothing to be found.
    NoUnknowns,
    /// No step lowers the cost, though the slope says that one should.
    Stuck,
    /// The iterations ran out.
    #[default]
    IterationLimit,
    /// The cost at the start is not a number.
    BadStart,
}

impl Termination {
    /// Whether the answer is a minimum.
    #[must_use]
    pub fn converged(self) -> bool {
        matches!(self, Self::SmallStep | Self::CostUnchanged | Self::NoUnknowns)
    }

    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::SmallStep => "converged: the last step was too small to matter",
            Self::CostUnchanged => "converged: the cost no longer changes",
            Self::NoUnknowns => "converged: everything is known",
            Self::Stuck => "not converged: no step lowers the cost",
            Self::IterationLimit => "not converged: the iterations ran out",
            Self::BadStart => "not converged: the cost at the start is not a number",
        }
    }
}

/// Where the time went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seconds {
    /// Linearising and assembling.
    pub linearise: f64,
    /// Factorising and solving.
    pub factorise: f64,
    /// Evaluating trial steps.
    pub evaluate: f64,
}

/// How the search went.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Why it ended.
    pub termination: Termination,
    /// Linearisations of all measurements.
    pub iterations: usize,
    /// Linearisations of a part of the measurements, from which the search of all began.
    pub thinned: usize,
    /// Robust cost at the start.
    pub initial_cost: f64,
    /// Robust cost at the end.
    pub final_cost: f64,
    /// Times that the equations were not positive definite or could not be solved to enough digits, and the damping was raised.
    pub refused: usize,
    /// Trial steps that did not lower the cost enough, after which the damping was raised.
    pub rejected: usize,
    /// The cost after every accepted step, first the start: never increasing.
    pub costs: Vec<f64>,
    /// Where the time went.
    pub seconds: Seconds,
}
