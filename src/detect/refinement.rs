//! What measuring a corner may come to.

use std::fmt;

/// Why a corner could not be measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weakness {
    /// The four corners given are not a convex quadrangle of some size.
    NotAQuadrangle,
    /// The lens model has no answer there.
    OutsideLens,
    /// One of its sides rises too little from black to white.
    NoContrast,
    /// One of its sides is too short, hidden, or outside the picture.
    TooFewEdges,
    /// One of its sides is no straight line.
    NotStraight,
    /// The lines meet too far from where the tag was found.
    MovedTooFar,
    /// The lines meet, but where is known to no better than [`super::edge_lines::LARGEST_DEVIATION`].
    TooUncertain,
}

impl fmt::Display for Weakness {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::NotAQuadrangle => "the corners are not a convex quadrangle",
            Self::OutsideLens => "the lens model has no answer there",
            Self::NoContrast => "a side has too little contrast",
            Self::TooFewEdges => "a side is too short, hidden or outside the picture",
            Self::NotStraight => "a side is not straight",
            Self::MovedTooFar => "the sides meet too far from where the tag was found",
            Self::TooUncertain => "the sides meet at too uncertain a place",
        })
    }
}

/// A corner after refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Refinement {
    /// Where it is (px) and `[suu, suv, svv]` (px^2).
    Refined {
        /// Where the corner is, px.
        pixel: [f64; 2],
        /// `[suu, suv, svv]`, px^2.
        covariance: [f64; 3],
    },
    /// It cannot be told well.
    Weak(Weakness),
}
