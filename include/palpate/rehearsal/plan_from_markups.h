#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/scene/plan_file.h"

namespace palpate {

/// A plan converted from markups.
struct PlanOfMarkups {
  PlanFile plan;
  std::vector<std::string> left_out;  ///< Names of points that are not part of a trajectory
};

/// Converts markups of 3D Slicer (.mrk.json) to a plan: one trajectory per Line, from its first control point
/// (entry) to its second (target), and one from points named Entry and Target (case-insensitive). RAS
/// coordinates are converted to LPS.
/// @param title  title of the plan
/// @param where  name of the file, for errors
/// Errors: kBadInput for those of parse_markups, other types of markups, lines without exactly two points,
/// and an Entry or Target point that is missing or duplicate.
Result<PlanOfMarkups> plan_from_markups(std::string_view text, const std::string& title,
                                        const std::string& where);

}  // namespace palpate
