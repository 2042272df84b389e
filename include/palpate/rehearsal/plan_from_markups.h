#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/scene/plan_file.h"

namespace palpate {

struct PlanOfMarkups {
  PlanFile plan;
  std::vector<std::string> left_out;  ///< names of points that say nothing of a trajectory
};

/// A plan of Slicer's markups (.mrk.json): a trajectory for each Line, whose two control points are its entry
/// and its target, in the order in which they were placed, and one for points that are called Entry and
/// Target (capitals do not matter). RAS is turned into LPS.
/// @param title  of the plan
/// @param where  the file's name, for errors
/// Errors: kBadInput for those of parse_markups, markups of other types by their name, lines that do not have
/// two points, and points of which one of the two is missing or there twice.
Result<PlanOfMarkups> plan_from_markups(std::string_view text, const std::string& title,
                                        const std::string& where);

}  // namespace palpate
