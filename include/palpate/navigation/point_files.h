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
  std::string name;  ///< "1", "2" ... where the file gives none
  Eigen::Vector3d at_mm =
      Eigen::Vector3d::Zero();   ///< LPS where the file says how its axes lie, else as it stands
  std::optional<double> fle_mm;  ///< see PointPair
};

/// What a file of Slicer's (.mrk.json) holds together.
struct Markup {
  std::string type;  ///< "Line", "Fiducial", "Curve", "ROI", ... as the file has it; empty: it does not say
  std::string name;  ///< empty where the file gives none
  std::vector<NamedPoint> points;  ///< its control points that are placed; LPS, mm
};
/// The markups of a .mrk.json, in their order, those without control points too. RAS is turned into LPS.
///
/// Errors: kBadInput for JSON that is none, no markup, axes other than LPS and RAS, another unit than
/// millimetres, and those of parse_points. @param where  the file's name, for errors
Result<std::vector<Markup>> parse_markups(std::string_view text, const std::string& where);

/// Points of text: Slicer's markups (.mrk.json: its control points that are placed; .fcsv), else a line for
/// each: `x y z`, `name x y z` (the name may be a number) or that with the point's error (mm) behind, parted
/// by commas, tabs, semicolons or spaces; `#` begins a comment, and a first line without numbers is a
/// heading. Millimetres. RAS, where a file of Slicer's says so, is turned into LPS.
///
/// Errors: kBadInput, with the line; nothing but those of JSON that is none, numbers that are none or not
/// finite, no point, more than 100 000.
/// @param where  the file's name, for errors
Result<std::vector<NamedPoint>> parse_points(std::string_view text, const std::string& where);

struct PoseFormat {
  /// Of a sequence that PLUS recorded (.mha, .igs.mha, .seq.mha): which of its transforms, e.g.
  /// "StylusToTracker". Empty: the only one.
  std::string transform;
  bool scalar_first = false;  ///< of a quaternion: w x y z; else x y z w
};
/// Poses of text, in its order: a sequence of PLUS' (poses that it calls invalid are passed over), else a
/// line for each, of 16 numbers (a matrix row by row), 12 (without its last row), or 7 (x y z and a
/// quaternion). As parse_points otherwise.
Result<std::vector<Transform<Tracker, TrackedTool>>> parse_poses(std::string_view text,
                                                                 const std::string& where,
                                                                 const PoseFormat& format = {});

}  // namespace palpate
