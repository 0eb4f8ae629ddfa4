//! What is wrong with a recording or its description, in one form.

/// What went wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum FaultKind {
    /// A tag was read as another one.
    WrongId,
    /// The corners of a tag begin elsewhere, or a flat target leans to the wrong side.
    Flipped,
    /// Single corners of a tag or board are off: shadows, reflections, occlusion.
    DraggedCorner,
    /// Tags or boards that are not where they should be, for no reason that was found.
    Unexplained,
    /// A picture shows another configuration than its name says.
    WrongPicture,
    /// The joint values of single configurations do not fit.
    WrongJointValues,
    /// Two lines of a joint log have changed places.
    SwappedLines,
    /// A joint log is late or early by some lines.
    ShiftedLog,
    /// Something moved while the recording was made.
    Moved,
    /// A target is larger or smaller than the layout says.
    WrongSize,
    /// The pictures of two cameras have changed places.
    SwappedCameras,
    /// No tag of a target was seen, but tags of another dictionary.
    WrongDictionary,
    /// Nothing of a target fits: another dictionary, another geometry.
    DoesNotFit,
}

impl FaultKind {
    /// The word that files carry.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::WrongId => "wrong_id",
            Self::Flipped => "flipped",
            Self::DraggedCorner => "dragged_corner",
            Self::Unexplained => "unexplained",
            Self::WrongPicture => "wrong_picture",
            Self::WrongJointValues => "wrong_joint_values",
            Self::SwappedLines => "swapped_lines",
            Self::ShiftedLog => "shifted_log",
            Self::Moved => "moved",
            Self::WrongSize => "wrong_size",
            Self::SwappedCameras => "swapped_cameras",
            Self::WrongDictionary => "wrong_dictionary",
            Self::DoesNotFit => "does_not_fit",
        }
    }
}

/// What was done about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// The measurements were set aside; the answer stands without them.
    Excluded,
    /// Leaving measurements out would not make the answer right: it is not to be used.
    Refused,
}

impl Action {
    /// The word that files carry.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Excluded => "excluded",
            Self::Refused => "refused",
        }
    }
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Fault {
    /// What kind of thing.
    pub kind: FaultKind,
    /// What, in one sentence without a full stop.
    pub what: String,
    /// The numbers that say so.
    pub evidence: String,
    /// What to do.
    pub remedy: String,
    /// What was done.
    pub action: Action,
}
