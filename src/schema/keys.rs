//! The table of keys.

/// What a key's value may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// A whole number from the first to the second.
    Whole(u32, u32),
    /// Any number.
    Number,
    /// A number above zero.
    Positive,
    /// A number of at least zero.
    NotNegative,
    /// A number from 0 to 1.
    Share,
    /// `true` or `false`.
    Flag,
    /// A word or a path.
    Text,
    /// One of these words.
    Choice(&'static [&'static str]),
    /// A list of exactly so many numbers.
    Numbers(usize),
    /// A list of any number of numbers.
    List,
    /// A list of exactly so many whole numbers of at least one.
    Counts(usize),
    /// A list of tag ids.
    Ids,
    /// Rows of numbers, each so long.
    Rows(usize),
    /// A list of some of these words.
    Words(&'static [&'static str]),
    /// A mapping of another section.
    Section(&'static str),
    /// A mapping from names to a section or kind.
    Named(&'static Kind),
    /// A list of mappings of a section.
    ListOf(&'static str),
    /// Any of these.
    Either(&'static [Kind]),
    /// The name of a tag dictionary.
    Dictionary,
    /// Anything: written by the program for itself.
    Anything,
}

/// One key.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// As written.
    pub name: &'static str,
    /// What it may be.
    pub kind: Kind,
    /// The unit; empty for none.
    pub unit: &'static str,
    /// What holds if it is left out; empty for a key that must be there.
    pub default: &'static str,
    /// What it means.
    pub words: &'static str,
}

/// A mapping with its keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Its name in the schema.
    pub name: &'static str,
    /// Where it stands and what it is.
    pub words: &'static str,
    /// Its keys.
    pub keys: &'static [Key],
    /// Sets of keys of which exactly one must be there; empty if any may be.
    pub one_of: &'static [&'static [&'static str]],
    /// Whether none of `one_of` will do too.
    pub or_none: bool,
}

const fn key(name: &'static str, kind: Kind, unit: &'static str, default: &'static str, words: &'static str) -> Key {
    Key { name, kind, unit, default, words }
}

const fn section(name: &'static str, words: &'static str, keys: &'static [Key]) -> Section {
    Section { name, words, keys, one_of: &[], or_none: false }
}

const UNKNOWN: Kind = Kind::Choice(&["unknown"]);
const POSE: Kind = Kind::Either(&[UNKNOWN, Kind::Section("pose")]);
const MOUNT: Key = key(
    "mount",
    Kind::Text,
    "",
    "world",
    "the frame it hangs on: `world`, a camera, a target, `ROBOT.base`, `ROBOT.linkN` or `ROBOT.flange`",
);
const POSE_KEY: Key =
    key("pose", POSE, "", "unknown", "parent_from_child; fixed, or with `sigma`, `start` or `unknown`");
const FILES: Kind = Kind::Either(&[Kind::Text, Kind::Words(&[])]);
const ROTATIONS: &[&[&str]] = &[&["rpy"], &["rotvec"], &["quat_xyzw"], &["quat_wxyz"], &["matrix"]];
const MATRIX: Kind = Kind::Either(&[Kind::Rows(3), Kind::Numbers(9)]);
const THREE_OR_ONE: Kind = Kind::Either(&[Kind::Positive, Kind::Numbers(3)]);

/// All sections, in the order of the book.
#[rustfmt::skip] // A table: a key a line.
pub const SECTIONS: &[Section] = &[
    section("layout", "The layout file as a whole.", &[
        key("cellmap", Kind::Whole(1, 1), "", "", "the version of the grammar"),
        key("units", Kind::Section("units"), "", "", "the units of this file and of its CSV files"),
        key("world", Kind::Text, "", "", "the frame whose pose is the identity; may be any frame that stands still, or a name of its own"),
        key("cameras", Kind::Named(&Kind::Section("camera")), "", "none", "by name"),
        key("robots", Kind::Named(&Kind::Section("robot")), "", "none", "by name"),
        key("sensors", Kind::Named(&Kind::Section("sensor")), "", "none", "sources of points, such as a laser tracker, by name"),
        key("targets", Kind::Named(&Kind::Section("target")), "", "none", "rigid things to look at, by name"),
        key("observations", Kind::Section("observations"), "", "`detections.csv` in the recording", "files of measurements"),
        key("solve", Kind::Section("solve"), "", "as below", "how to solve"),
        key("simulate", Kind::Section("simulate"), "", "as below", "how `cellmap simulate` makes a recording"),
        key("solution", Kind::Anything, "", "none", "written by `cellmap solve`; leave it as it is"),
    ]),
    section("units", "Under `units` of a layout, robot file or target file.", &[
        key("length", Kind::Choice(&["m", "mm", "cm", "in"]), "", "", "unit of lengths"),
        key("angle", Kind::Choice(&["rad", "deg"]), "", "", "unit of angles"),
    ]),
    section("camera", "Under `cameras: NAME:`.", &[
        key("images", Kind::Text, "", "none", "path of its pictures with `{configuration}` and, for several at one stop, `{shot}`; `{configuration:04}` pads with zeros"),
        key("intrinsics", Kind::Either(&[Kind::Text, Kind::Section("intrinsics")]), "", "none", "its lens, here or in a file with the same keys; needed with `images`"),
        key("refine", Kind::Words(&["focal", "centre", "distortion"]), "", "nothing", "what of its lens is to be found too"),
        MOUNT,
        POSE_KEY,
    ]),
    section("intrinsics", "Under `intrinsics` of a camera, or a file of its own.", &[
        key("model", Kind::Choice(&["pinhole", "brown", "rational", "kannala_brandt", "fisheye"]), "", "", "the lens model; `fisheye` is another word for `kannala_brandt`"),
        key("size", Kind::Counts(2), "px", "", "width and height of a picture"),
        key("focal", Kind::Numbers(2), "px", "", "focal lengths fx, fy"),
        key("centre", Kind::Numbers(2), "px", "", "principal point cx, cy; the centre of the top left pixel is (0, 0), as in OpenCV"),
        key("distortion", Kind::List, "", "zeros", "`brown`: k1 k2 p1 p2 k3; `rational`: k1 k2 p1 p2 k3 k4 k5 k6; `kannala_brandt`: k1 k2 k3 k4"),
    ]),
    Section { one_of: &[&["model", "joints"], &["flange_poses"]], ..section("robot", "Under `robots: NAME:`. Its frames are `NAME.base`, `NAME.link1`..., `NAME.flange`.", &[
        key("model", Kind::Either(&[Kind::Choice(&["ur3", "ur5", "ur10", "ur3e", "ur5e", "ur10e", "ur16e", "ur20", "ur30"]), Kind::Section("model")]), "", "none", "a built-in name, or where its kinematics are"),
        key("joints", Kind::Text, "", "none", "CSV file `configuration,robot,q1..qn`; with `model`"),
        key("flange_poses", Kind::Text, "", "none", "CSV file `configuration,robot,x,y,z,qx,qy,qz,qw`; in place of `model` and `joints`"),
        MOUNT,
        POSE_KEY,
        key("identify", Kind::Section("identify"), "", "nothing", "which link parameters are to be found too"),
        key("repeatability", Kind::Section("repeatability"), "", "none: it stops where its log says", "how far from its log it really stops, drawn anew at each configuration"),
        key("corrections", Kind::Rows(4), "length, angle", "zeros", "one `[offset, d, a, alpha]` a joint, as a solution has them"),
    ]) },
    Section { one_of: &[&["mdh"], &["dh"], &["urdf", "base", "tip"]], ..section("model", "Under `model` of a robot.", &[
        key("mdh", Kind::Text, "", "none", "a robot file in modified DH after Craig"),
        key("dh", Kind::Text, "", "none", "a robot file in classic DH"),
        key("urdf", Kind::Text, "", "none", "a URDF file"),
        key("base", Kind::Text, "", "none", "the link that is the base, with `urdf`"),
        key("tip", Kind::Text, "", "none", "the link that is the flange, with `urdf`"),
    ]) },
    section("identify", "Under `identify` of a robot.", &[
        key("joint_offsets", Kind::Section("belief"), "", "not found", "what is added to the joint values"),
        key("lengths", Kind::Section("belief"), "", "not found", "`a` and `d` of every link"),
        key("angles", Kind::Section("belief"), "", "not found", "`alpha` of every link"),
    ]),
    section("repeatability", "Under `repeatability` of a robot: standard deviations per axis of where its flange really stops.", &[
        key("xyz", Kind::Positive, "length", "", "of the flange's translation"),
        key("rotation", Kind::Positive, "angle", "", "of its rotation vector"),
    ]),
    section("belief", "A family of link parameters.", &[
        key("sigma", Kind::Positive, "length or angle", "no prior", "standard deviation of the prior about the model"),
    ]),
    section("sensor", "Under `sensors: NAME:`.", &[
        key("measures", Kind::Choice(&["points"]), "", "", "what it gives"),
        MOUNT,
        POSE_KEY,
    ]),
    Section { one_of: &[&["tags"], &["checkerboard"], &["charuco"], &["april_grid"], &["points"]], or_none: true, ..section("target", "Under `targets: NAME:`. One kind of geometry; none for a target that is known only through measured poses.", &[
        key("tags", Kind::Section("tags"), "", "none", "square tags"),
        key("checkerboard", Kind::Section("checkerboard"), "", "none", "a checkerboard"),
        key("charuco", Kind::Section("charuco"), "", "none", "a ChArUco board"),
        key("april_grid", Kind::Section("april_grid"), "", "none", "a grid of AprilTags as Kalibr counts it"),
        key("points", Kind::Named(&Kind::Either(&[UNKNOWN, Kind::Numbers(3), Kind::Section("point")])), "length", "none", "named points: `[x, y, z]` or `unknown`"),
        key("geometry", UNKNOWN, "", "known", "every tag's place but the first's is to be found"),
        MOUNT,
        key("moves", Kind::Flag, "", "false", "whether it has a new unknown pose at each configuration"),
        POSE_KEY,
    ]) },
    Section { one_of: &[&["file"], &["places"], &["grid"], &["cube"], &["size", "ids"]], ..section("tags", "Under `tags` of a target.", &[
        key("dictionary", Kind::Dictionary, "", "", "which family of tags, for example `6x6_250` or `apriltag_36h11`"),
        key("size", Kind::Positive, "length", "none", "outer edge of the black border, with `ids`"),
        key("ids", Kind::Ids, "", "none", "a single tag is the target's frame; of several without a file the places are unknown"),
        key("file", Kind::Text, "", "none", "a target file"),
        key("grid", Kind::Section("grid"), "", "none", "a flat grid, numbered row by row from the top left"),
        key("cube", Kind::Section("cube"), "", "none", "a cube with a tag on each of up to six faces"),
        key("places", Kind::ListOf("place"), "", "none", "each tag with its place, as in a target file"),
    ]) },
    section("grid", "Under `grid` of `tags`.", &[
        key("columns", Kind::Whole(1, 1000), "", "", "tags along x"),
        key("rows", Kind::Whole(1, 1000), "", "", "tags along y"),
        key("size", Kind::Positive, "length", "", "outer edge of a tag's black border"),
        key("gap", Kind::Positive, "length", "", "between the borders of neighbours"),
        key("first_id", Kind::Whole(0, 1_000_000), "", "0", "the top left tag's id"),
    ]),
    section("cube", "Under `cube` of `tags`. The frame is the middle of the cube.", &[
        key("edge", Kind::Positive, "length", "", "edge of the cube"),
        key("size", Kind::Positive, "length", "", "outer edge of a tag's black border"),
        key("ids", Kind::Ids, "", "", "on the faces +x, +y, -x, -y, +z, -z, in this order"),
    ]),
    section("place", "An entry of `places`, or of `tags` in a target file.", &[
        key("id", Kind::Whole(0, 1_000_000), "", "", "the tag's id"),
        key("size", Kind::Positive, "length", "", "outer edge of its black border"),
        key("pose", POSE, "", "", "target_from_tag: x right, y up, z out of the face; `unknown`"),
    ]),
    section("checkerboard", "Under `checkerboard` of a target. The frame's origin is the first inner corner, z into the board.", &[
        key("corners", Kind::Counts(2), "", "", "inner corners along x and y; one odd and one even count leaves no doubt which way up it is"),
        key("square", Kind::Positive, "length", "", "edge of a square"),
    ]),
    section("charuco", "Under `charuco` of a target.", &[
        key("squares", Kind::Counts(2), "", "", "squares along x and y"),
        key("square", Kind::Positive, "length", "", "edge of a square"),
        key("marker", Kind::Positive, "length", "", "edge of a marker, less than `square`"),
        key("dictionary", Kind::Dictionary, "", "", "which family of markers"),
    ]),
    section("april_grid", "Under `april_grid` of a target. Numbered from the bottom left, rightwards then upwards; the frame is at the bottom left of the first tag.", &[
        key("columns", Kind::Whole(1, 100), "", "", "tags along x"),
        key("rows", Kind::Whole(1, 100), "", "", "tags along y"),
        key("size", Kind::Positive, "length", "", "outer edge of a tag's black border"),
        key("spacing", Kind::Positive, "share of `size`", "", "gap between neighbours"),
        key("first_id", Kind::Whole(0, 1_000_000), "", "0", "the first tag's id"),
        key("dictionary", Kind::Dictionary, "", "apriltag_36h11", "which family of tags"),
    ]),
    section("point", "A point whose place a simulation knows and a solver does not.", &[
        key("xyz", Kind::Numbers(3), "length", "", "where it is"),
        key("unknown", Kind::Flag, "", "false", "hides the place from the solver"),
    ]),
    Section { one_of: ROTATIONS, ..section("pose", "Under `pose`. Exactly one rotation; at most one of `sigma`, `start` and `unknown`.", &[
        key("xyz", Kind::Numbers(3), "length", "", "origin of the child in the parent"),
        key("rpy", Kind::Numbers(3), "angle", "none", "turns about the fixed x, y, z axes in this order, as in URDF"),
        key("rotvec", Kind::Numbers(3), "angle", "none", "rotation vector"),
        key("quat_xyzw", Kind::Numbers(4), "", "none", "unit quaternion, w last"),
        key("quat_wxyz", Kind::Numbers(4), "", "none", "unit quaternion, w first"),
        key("matrix", MATRIX, "", "none", "rotation matrix, three rows of three"),
        key("start", Kind::Flag, "", "false", "only a starting value"),
        key("unknown", Kind::Flag, "", "false", "for a simulation only; hidden from the solver"),
        key("sigma", Kind::Section("sigma"), "", "none", "makes it a prior with this standard deviation"),
    ]) },
    Section { one_of: ROTATIONS, ..section("plain_pose", "A pose in a robot file.", &[
        key("xyz", Kind::Numbers(3), "length", "", "origin of the child in the parent"),
        key("rpy", Kind::Numbers(3), "angle", "none", "turns about the fixed x, y, z axes in this order, as in URDF"),
        key("rotvec", Kind::Numbers(3), "angle", "none", "rotation vector"),
        key("quat_xyzw", Kind::Numbers(4), "", "none", "unit quaternion, w last"),
        key("quat_wxyz", Kind::Numbers(4), "", "none", "unit quaternion, w first"),
        key("matrix", MATRIX, "", "none", "rotation matrix, three rows of three"),
    ]) },
    section("sigma", "Under `sigma` of a pose.", &[
        key("xyz", THREE_OR_ONE, "length", "", "standard deviation of the translation, one number or one an axis"),
        key("rotation", THREE_OR_ONE, "angle", "", "standard deviation of the rotation vector"),
    ]),
    section("observations", "Under `observations`. Each a CSV file of the recording, or a list of them.", &[
        key("detections", FILES, "px", "none", "corners: `configuration,shot,camera,target,tag,corner,u,v` and optionally `suu,suv,svv`"),
        key("target_poses", FILES, "length", "none", "camera_from_target: `configuration,shot,camera,target,x,y,z,qx,qy,qz,qw`"),
        key("points", FILES, "length", "none", "points of a sensor: `configuration,shot,sensor,point,x,y,z`"),
        key("contacts", FILES, "length", "none", "touching points: `configuration,frame_a,point_a,frame_b,point_b,distance`"),
    ]),
    section("solve", "Under `solve`.", &[
        key("loss", Kind::Either(&[Kind::Choice(&["squared"]), Kind::Section("loss")]), "", "{huber: 1.5}", "how strongly what does not fit is still listened to"),
        key("pixel_sigma", Kind::Positive, "px", "0.1", "standard deviation of a corner, added in quadrature to its own"),
        key("point_sigma", Kind::Positive, "length", "1 mm", "standard deviation of a measured point per axis"),
        key("pose_sigma", Kind::Section("pose_sigma"), "", "3 mm, 0.01 rad", "standard deviation of a measured pose"),
        key("contact_sigma", Kind::Positive, "length", "1 mm", "standard deviation of a contact"),
    ]),
    Section { one_of: &[&["huber"], &["cauchy"], &["tukey"]], ..section("loss", "Under `loss` of `solve`; k in standard deviations.", &[
        key("huber", Kind::Positive, "sigmas", "none", "linear beyond k"),
        key("cauchy", Kind::Positive, "sigmas", "none", "logarithmic beyond k"),
        key("tukey", Kind::Positive, "sigmas", "none", "constant beyond k"),
    ]) },
    section("pose_sigma", "Under `pose_sigma` of `solve`.", &[
        key("xyz", Kind::Positive, "length", "", "of the translation per axis"),
        key("rotation", Kind::Positive, "angle", "", "of the rotation vector per axis"),
    ]),
    section("simulate", "Under `simulate`.", &[
        key("configurations", Kind::Whole(1, 1_000_000), "", "40", "stops of the robots, when the path is generated"),
        key("shots", Kind::Whole(1, 1_000_000), "", "1", "pictures a camera takes at each stop"),
        key("path", Kind::Choice(&["recorded", "generated"]), "", "recorded if the robots' files are there", "where joint values come from"),
        key("joints", Kind::Named(&Kind::Rows(2)), "angle, length", "half a turn either way", "by robot: least and greatest value of each joint"),
        key("floor", Kind::Either(&[Kind::Number, Kind::Choice(&["none"])]), "length", "0", "least height of a robot's links above its base's plane"),
        key("pixel_sigma", Kind::NotNegative, "px", "as in `solve`", "noise of a corner per axis"),
        key("point_sigma", Kind::NotNegative, "length", "as in `solve`", "noise of a point per axis"),
        key("pose_sigma", Kind::Section("scatter"), "", "as in `solve`", "noise of a measured pose"),
        key("repeatability", Kind::Section("scatter"), "", "0", "where a robot really stops"),
        key("missing", Kind::Share, "", "0", "share of pictures that do not exist"),
        key("outliers", Kind::Section("outliers"), "", "none", "what goes wrong in real recordings"),
        key("link_errors", Kind::Section("link_errors"), "", "0", "standard deviations of the real links about the model"),
        key("lens_errors", Kind::Section("lens_errors"), "", "0", "standard deviations of the real lenses about the layout's"),
        key("picture", Kind::Section("picture"), "", "as below", "what pictures look like"),
    ]),
    section("scatter", "Under `pose_sigma` and `repeatability` of `simulate`.", &[
        key("xyz", Kind::NotNegative, "length", "0", "of the translation per axis"),
        key("rotation", Kind::NotNegative, "angle", "0", "of the rotation vector per axis"),
    ]),
    section("outliers", "Under `outliers` of `simulate`.", &[
        key("wrong_id", Kind::Share, "", "0", "share of tags that carry another's id"),
        key("flipped", Kind::Share, "", "0", "share of tags whose corners begin a turn off, and of poses that are the mirrored solution"),
        key("dragged", Kind::Share, "", "0", "share of tags or boards with a corner dragged away"),
        key("shifted_log", Kind::Text, "", "none", "the robot whose joint values are one line off from the middle on"),
        key("moved", Kind::Section("moved"), "", "none", "something that was knocked half way through"),
    ]),
    section("moved", "Under `moved` of `outliers`.", &[
        key("frame", Kind::Text, "", "", "what was knocked"),
        key("xyz", Kind::NotNegative, "length", "0", "how far"),
        key("rotation", Kind::NotNegative, "angle", "0", "how much it turned"),
    ]),
    section("link_errors", "Under `link_errors` of `simulate`.", &[
        key("joint_offsets", Kind::NotNegative, "angle", "0", "of joint offsets"),
        key("lengths", Kind::NotNegative, "length", "0", "of `a` and `d`"),
        key("angles", Kind::NotNegative, "angle", "0", "of `alpha`"),
    ]),
    section("lens_errors", "Under `lens_errors` of `simulate`.", &[
        key("focal", Kind::NotNegative, "px", "0", "of focal lengths"),
        key("centre", Kind::NotNegative, "px", "0", "of the principal point"),
        key("distortion", Kind::NotNegative, "", "0", "of distortion coefficients"),
    ]),
    section("picture", "Under `picture` of `simulate`.", &[
        key("blur", Kind::NotNegative, "px", "0.7", "standard deviation of the lens's blur"),
        key("motion_blur", Kind::NotNegative, "px", "0", "length of the smear of a moving camera or target"),
        key("noise", Kind::NotNegative, "grey values", "2", "standard deviation of the sensor's noise"),
        key("exposure", Kind::Positive, "", "1", "brightness"),
        key("vignetting", Kind::Share, "", "0.15", "loss of light in the corners"),
        key("clutter", Kind::Flag, "", "true", "walls, floor and things that stand about"),
        key("jpeg_quality", Kind::Whole(1, 100), "", "92", "for pictures named .jpg"),
    ]),
    section("robot_file", "A robot model file.", &[
        key("cellmap_robot", Kind::Whole(1, 1), "", "", "the version of the grammar"),
        key("units", Kind::Section("units"), "", "", "the units of this file"),
        key("convention", Kind::Choice(&["mdh", "dh"]), "", "", "modified DH after Craig, or classic DH"),
        key("base", Kind::Section("plain_pose"), "", "the identity", "base_from_first: before the first link"),
        key("flange", Kind::Section("plain_pose"), "", "the identity", "last_from_flange: after the last joint"),
        key("joints", Kind::ListOf("joint"), "", "", "one a joint"),
    ]),
    section("joint", "An entry of `joints` in a robot file.", &[
        key("alpha", Kind::Number, "angle", "", "twist"),
        key("a", Kind::Number, "length", "", "length"),
        key("theta", Kind::Number, "angle", "", "added to the joint value"),
        key("d", Kind::Number, "length", "", "offset; a prismatic joint's value is added to it"),
        key("type", Kind::Choice(&["revolute", "prismatic"]), "", "revolute", "how it moves"),
    ]),
    section("target_file", "A target file.", &[
        key("cellmap_target", Kind::Whole(1, 1), "", "", "the version of the grammar"),
        key("units", Kind::Section("units"), "", "", "the units of this file"),
        key("dictionary", Kind::Dictionary, "", "", "which family of tags"),
        key("tags", Kind::ListOf("place"), "", "", "each tag with its place"),
    ]),
];
