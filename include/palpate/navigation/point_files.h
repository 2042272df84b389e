#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/navigation/pivot.h"

namespace palpate {

struct NamedPoint {
  std::string name;  ///< Name; "1", "2" ... if the file has none
  /// LPS if the file declares its axes, otherwise as written
  Eigen::Vector3d at_mm = Eigen::Vector3d::Zero();
  std::optional<double> fle_mm;  ///< RMS localisation error, as PointPair::fle_mm
};

/// One markup of a 3D Slicer file (.mrk.json).
struct Markup {
  std::string type;  ///< Type: "Line", "Fiducial", "Curve", "ROI", ... as in the file; empty: not declared
  std::string name;  ///< Name of the markup; empty: none
  std::vector<NamedPoint> points;  ///< Control points with a defined position; LPS, mm
};
/// Parses all markups of a .mrk.json file in their order, including those without control points. RAS is
/// converted to LPS.
///
/// Errors: kBadInput for invalid JSON, no markup, axes other than LPS and RAS, a unit other than millimetres,
/// and those of parse_points.
/// @param where  name of the file, for errors
Result<std::vector<Markup>> parse_markups(std::string_view text, const std::string& where);

/// Parses points from a text: 3D Slicer markups (.mrk.json, control points with a defined position; .fcsv),
/// otherwise one point per line, as `x y z` or `name x y z` (the name may be a number), optionally followed
/// by the point's error (mm). Separators are commas, tabs, semicolons or spaces; `#` starts a comment, and a
/// first line without numbers is a heading. Units are millimetres. RAS is converted to LPS if a Slicer file
/// declares it.
///
/// Errors: kBadInput with the line for invalid JSON, invalid or non-finite numbers, no point, or more than
/// 100 000 points.
/// @param where  name of the file, for errors
Result<std::vector<NamedPoint>> parse_points(std::string_view text, const std::string& where);

/// Interpretation of a file of poses.
struct PoseFormat {
  /// Name of the transform in a sequence recorded by PLUS (.mha, .igs.mha, .seq.mha), e.g. "StylusToTracker".
  /// Empty: the only one.
  std::string transform;
  bool scalar_first = false;  ///< Order of a quaternion: w x y z if true, otherwise x y z w
};
/// Parses poses from a text, in its order: a PLUS sequence (poses marked invalid are skipped), otherwise one
/// pose per line, as 16 numbers (matrix, row by row), 12 (without the last row) or 7 (x y z and a
/// quaternion). Otherwise as parse_points.
Result<std::vector<Transform<Tracker, TrackedTool>>> parse_poses(std::string_view text,
                                                                 const std::string& where,
                                                                 const PoseFormat& format = {});

}  // namespace palpate
