#include <algorithm>
#include <string>

#include "palpate/scene/task_file.h"

namespace palpate {

const std::array<MetricInfo, kMetricCount>& metric_infos() {
  static constexpr std::array<MetricInfo, kMetricCount> infos{{
      {Metric::kTime, "time", "Time", "s", false, false, "from the first tick to the task's end",
       "FAST stations' benchmarks (2026); Tuijthof et al., PMC3023859",
       "distinguished experts from novices on ArthroS (10.1007/s00167-016-4114-1) but not on ArthroSim"},
      {Metric::kIdleTime, "idle_time", "Idle time", "s", false, false,
       "time in which nothing is touched and the tip, low-passed, is slower than 5 mm/s",
       "lack of motion: D'Angelo et al. 2015 (PMC4412306); the bound of 5 mm/s and the one hand are "
       "palpate's own",
       "attendings had fewer idle periods than students at some steps of suturing (15 persons)"},
      {Metric::kPathLength, "path_length", "Path length", "mm", false, false,
       "path length of the tip in the patient after a second-order Butterworth low-pass at 10 Hz",
       "10.1007/s00167-016-4114-1",
       "distinguished experts from novices on ArthroS; two thirds of that simulator's other metrics did not"},
      {Metric::kEconomy, "economy", "Economy of motion", "1", true, false,
       "length of the straight path from start to end through the places where steps were done, divided by "
       "path_length",
       "economy of motion as in MIST-VR and ArthroS", "not validated here"},
      {Metric::kSmoothness, "smoothness", "Smoothness (log dimensionless jerk)", "1", true, false,
       "log dimensionless jerk, -ln(T^3 / v_peak^2 * integral of jerk^2), of the low-passed path at 100 Hz",
       "Hogan and Sternad 2009 (J Mot Behav 41:529); Balasubramanian et al. 2012 (IEEE TBME 59:2126)",
       "falls with the length of a run: compare only runs of the same task. Not validated here"},
      {Metric::kMeanForce, "mean_force", "Mean force", "N", false, true,
       "time mean of the normal force sent while it is above 0", "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus"},
      {Metric::kPeakForce, "peak_force", "Peak force", "N", false, true,
       "greatest normal force sent in any tick", "Tuijthof et al., PMC3023859",
       "experts differed from novices at the meniscus; 8.5 N is the theoretical limit"},
      {Metric::kForceInBand, "force_in_band", "Contact time with force in band", "1", true, false,
       "fraction of the contact time in which the force sent on each [[force]] was in its band",
       "bands as in Tuijthof et al., PMC3023859; the fraction itself is palpate's own", "not validated here"},
      {Metric::kLongestInBand, "longest_in_band", "Longest time in band", "s", true, false,
       "longest uninterrupted time in which the force sent on a [[force]] was in its band", "palpate's own",
       "not validated here"},
      {Metric::kExcessImpulse, "excess_impulse", "Excess impulse", "N s", false, false,
       "integral of max(0, force sent - limit) over every [[force]] with a limit",
       "palpate's own; forces as measures of skill: Horeman et al. 2012 (IEEE Trans Haptics 5:312)",
       "not validated here"},
      {Metric::kCoverage, "coverage", "Surface coverage", "1", true, false,
       "fraction of the 1 mm patches of all regions to be covered that were within 0.5 mm of the path of a "
       "touch of 0.2 N or more that moved by at least 2 mm",
       "palpate's own", "not validated here"},
      {Metric::kProtectedTime, "protected_time", "Contact time on protected structures", "s", false, false,
       "time in which the force sent on any [[protected]] was above its limit", "palpate's own",
       "not validated here"},
      {Metric::kStepsDone, "steps_done", "Steps completed", "1", true, false,
       "fraction of the steps that were done",
       "completion, as in task-specific checklists (ASSET, PMC4574927)",
       "checklist by raters: ASSET; this count: not validated here"},
      {Metric::kAnswerError, "answer_error", "Answer error", "mm", false, false,
       "distance from the centre of the structure to be found to the line through the answered place along "
       "the surface's normal",
       "palpate's own", "not validated here"},
      {Metric::kUnseenTime, "unseen_time", "Contact time out of the scope's view", "s", false, false,
       "time of contact of the first device outside the view of the second device's scope",
       "palpate's own; keeping the instrument in view: ASSET's field of view (PMC4574927)",
       "domain as rated: ASSET; this time: not validated here"},
      {Metric::kRemovedInPlan, "removed_in_plan", "Volume removed inside the plan", "mm3", true, false,
       "volume removed inside the plan's regions", "palpate's own", "not validated here"},
      {Metric::kRemovedOutside, "removed_outside", "Volume removed outside the plan", "mm3", false, false,
       "volume removed outside the plan's regions", "palpate's own", "not validated here"},
      {Metric::kProtectedRemoved, "protected_removed", "Volume removed from protected structures", "mm3",
       false, false, "volume removed from every [[protected]] structure, inside the plan or not",
       "palpate's own", "not validated here"},
      {Metric::kDepthPastPlan, "depth_past_plan", "Maximum depth beyond the plan", "mm", false, false,
       "greatest distance of removed volume from the nearest of the plan's shapes, if it lies outside all of "
       "them",
       "palpate's own", "not validated here"},
      {Metric::kBoneLeft, "bone_left", "Bone left", "mm", true, true,
       "smallest distance of removed volume from the structures' surface before any removal; negative: the "
       "depth to which they were cut",
       "palpate's own; that the sinus is skeletonised is an item of the Melbourne Mastoidectomy Scale",
       "items as rated: ten surgical trainees struggled with those on the sinus; this distance: not "
       "validated "
       "here",
       "over", true},
      {Metric::kBurrDistance, "burr_distance", "Smallest distance of the running burr", "mm", true, true,
       "smallest distance of the running burr's head from the structures' surface before any removal; "
       "negative: inside",
       "Sewell et al. 2008 (10.3109/10929080801957712): distances to structures in a mastoidectomy",
       "experts used more caution near structures than residents (7 and 7 persons, "
       "10.1097/mao.0000000000001398); this distance: not validated here",
       "to", true},
      {Metric::kForceNear, "force_near", "Peak force of the running burr", "N", false, true,
       "greatest normal force sent while the running burr's head is within `within` of the structures",
       "Sewell et al. 2008 (10.3109/10929080801957712): forces by the distance to structures",
       "experts used higher forces than residents, and more caution near structures (7 and 7 persons, "
       "10.1097/mao.0000000000001398); this force: not validated here",
       "near", true},
      {Metric::kHiddenTime, "hidden_time", "Cutting time out of the microscope's view", "s", false, false,
       "time in which the running burr touches something and no line of sight from it to the microscope, "
       "within its tilt, is free of tissue that is left",
       "Sewell et al. 2008 (10.3109/10929080801957712): bone removed without being seen",
       "not validated here"},
  }};
  return infos;
}

std::string readable_metric_name(std::string_view stored) {
  constexpr std::string_view kOf = " of ";
  const std::size_t separator = stored.find(kOf);
  const auto info = std::ranges::find(metric_infos(), stored.substr(0, separator), &MetricInfo::name);
  if (info == metric_infos().end()) return std::string(stored);
  std::string text(info->title);
  if (separator == std::string_view::npos) return text;
  std::string structures(stored.substr(separator + kOf.size()));
  std::ranges::replace(structures, '_', ' ');
  return text + " " + std::string(info->relation) + " " + structures;
}

std::string metric_table() {
  std::string text =
      "| metric | shown as | unit | better | what it is | source | validity "
      "|\n|---|---|---|---|---|---|---|\n";
  for (const MetricInfo& info : metric_infos()) {
    text += "| `" + std::string(info.name) + "` | " + std::string(info.title) + " | " +
            std::string(info.unit) + " | " + (info.more_is_better ? "more" : "less") + " | " +
            std::string(info.formula) + " | " + std::string(info.source) + " | " +
            std::string(info.validity) + " |\n";
  }
  return text;
}

}  // namespace palpate
