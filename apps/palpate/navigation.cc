#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <vector>

#include "inputs.h"
#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/navigation/pivot.h"
#include "palpate/navigation/point_files.h"
#include "palpate/navigation/registration.h"
#include "palpate/navigation/surface_registration.h"
#include "palpate/surfaces/surfaces.h"
#include "palpation.h"
#include "text.h"
#include "verb.h"

/// Where a tracked patient and a tracked tool are: from files.
namespace palpate::app {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::size_t kMostPoints_bytes = std::size_t{1} << 24, kMostPoses_bytes = std::size_t{1} << 28;

Json json_of(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}
Json rows_of(const Transform<Patient, Tracker>& X) {
  Json rows = Json::array();
  for (int r = 0; r < 3; ++r)
    rows.push_back({X.linear()(r, 0), X.linear()(r, 1), X.linear()(r, 2), X.translation()[r]});
  rows.push_back({0, 0, 0, 1});
  return rows;
}
std::string shown_name(const std::string& name) {
  return fitted(printable_name(name), 16);
}

Result<void> write_json(const std::filesystem::path& file, const Json& json) {
  return write_file(file, json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

// ---- pivot

struct PivotVerb {
  std::filesystem::path poses, output;
  PoseFormat format;
  std::string quaternion = "xyzw";
};

int pivot(const PivotVerb& options, Console& console) {
  std::optional<OutputClaim> claim;
  if (!options.output.empty()) {
    auto claimed = claim_output(options.output, std::array{options.poses});
    if (!claimed) return console.fail(claimed.error());
    claim.emplace(std::move(*claimed));
  }
  const auto text = read_file(options.poses, kMostPoses_bytes);
  if (!text) return console.fail(text.error());
  PoseFormat format = options.format;
  format.scalar_first = options.quaternion == "wxyz";
  const auto poses = parse_poses(*text, options.poses.string(), format);
  if (!poses) return console.fail(poses.error());
  const auto found = calibrate_pivot(*poses);
  if (!found) {
    Error error = found.error();
    error.where = options.poses.string();
    return console.fail(error);
  }
  const int left_out = static_cast<int>(poses->size()) - found->used;
  std::printf("tip in the tool's frame     %.3f, %.3f, %.3f mm\n", found->tip.x(), found->tip.y(),
              found->tip.z());
  std::printf("where it stood              %.3f, %.3f, %.3f mm, of the tracker\n", found->pivot.x(),
              found->pivot.y(), found->pivot.z());
  std::printf("left over                   %.3f mm (root mean square of %d poses)\n", found->rms_mm,
              found->used);
  std::printf("error of the tip            %.3f mm (root of its expected square)\n", found->tip_error_mm);
  std::printf("turned by                   %.1f degrees where it turned least\n", found->turn_deg);
  std::printf("left out                    %d of %zu poses, which do not agree with the others\n", left_out,
              poses->size());
  if (!options.output.empty()) {
    Json json{{"tip_mm", json_of(found->tip.eigen())},
              {"pivot_mm", json_of(found->pivot.eigen())},
              {"rms_mm", found->rms_mm},
              {"tip_error_mm", found->tip_error_mm},
              {"turn_deg", found->turn_deg},
              {"poses", poses->size()},
              {"used", found->used}};
    Json outliers = Json::array();
    for (std::size_t n = 0; n < poses->size(); ++n)
      if (found->is_outlier[n]) outliers.push_back(n + 1);
    json["left_out"] = outliers;
    if (const auto written = write_json(options.output, json); !written) return console.fail(written.error());
    console.note("tip: " + options.output.string());
  }
  return kExitOk;
}

// ---- register

struct RegisterVerb {
  std::filesystem::path scan_points, tracked_points, touched, output;
  std::string surface, structure;
  std::optional<double> fle_mm;
  double tip_radius_mm = 0;
  std::vector<std::vector<double>> targets;
};

// by name where both files name the same points, else by their order
Result<std::vector<PointPair>> pair_up(const std::vector<NamedPoint>& scan,
                                       const std::vector<NamedPoint>& tracked, const RegisterVerb& options,
                                       Console& console) {
  std::map<std::string, const NamedPoint*> by_name;
  for (const NamedPoint& point : tracked) by_name.emplace(point.name, &point);
  std::set<std::string> names;
  for (const NamedPoint& point : scan) names.insert(point.name);
  const bool are_unique = by_name.size() == tracked.size() && names.size() == scan.size();
  const bool are_named = are_unique && std::any_of(scan.begin(), scan.end(), [&](const auto& point) {
                           return by_name.contains(point.name);
                         });
  std::vector<PointPair> pairs;
  const auto add = [&](const NamedPoint& in_scan, const NamedPoint& seen) {
    pairs.push_back(
        {in_scan.name, Point<Patient>(in_scan.at_mm), Point<Tracker>(seen.at_mm), seen.fle_mm.value_or(1)});
  };
  if (are_named) {
    for (const NamedPoint& point : scan)
      if (const auto same = by_name.find(point.name); same != by_name.end())
        add(point, *same->second);
      else
        console.warn()(printable_name(point.name) + " was not tracked: left out");
    for (const NamedPoint& point : tracked)
      if (!names.contains(point.name))
        console.warn()(printable_name(point.name) + " is not in the scan: left out");
    return pairs;
  }
  if (scan.size() != tracked.size())
    return Error{ErrorKind::kBadInput,
                 "has " + std::to_string(tracked.size()) + " points, and the scan " +
                     std::to_string(scan.size()) + ", with other names",
                 options.tracked_points.string(),
                 "name the points alike in both files, or list as many in the same order"};
  console.note("the points have other names in the two files: paired in their order");
  for (std::size_t n = 0; n < scan.size(); ++n) add(scan[n], tracked[n]);
  return pairs;
}

Result<std::vector<NamedPoint>> points_of(const std::filesystem::path& file) {
  const auto text = read_file(file, kMostPoints_bytes);
  if (!text) return text.error();
  return parse_points(*text, file.string());
}

int register_verb(const RegisterVerb& options, Console& console) {
  std::vector<std::filesystem::path> inputs = input_files(options.surface);
  for (const auto& file : {options.scan_points, options.tracked_points, options.touched})
    if (!file.empty()) inputs.push_back(file);
  std::optional<OutputClaim> claim;
  if (!options.output.empty()) {
    auto claimed = claim_output(options.output, inputs);
    if (!claimed) return console.fail(claimed.error());
    claim.emplace(std::move(*claimed));
  }
  if (options.surface.empty() != options.touched.empty() ||
      options.surface.empty() != options.structure.empty())
    return console.fail({ErrorKind::kUsage, "a surface needs --surface, --structure and --touched", "",
                         "give all three, or none"});

  const auto scan = points_of(options.scan_points);
  if (!scan) return console.fail(scan.error());
  const auto tracked = points_of(options.tracked_points);
  if (!tracked) return console.fail(tracked.error());
  auto pairs = pair_up(*scan, *tracked, options, console);
  if (!pairs) return console.fail(pairs.error());
  const auto stated = std::count_if(tracked->begin(), tracked->end(),
                                    [](const auto& point) { return point.fle_mm.has_value(); });
  if (!options.fle_mm && stated > 0 && stated < std::ssize(*tracked))
    return console.fail({ErrorKind::kBadInput,
                         "says of " + std::to_string(stated) + " of " + std::to_string(tracked->size()) +
                             " points how wrong they are",
                         options.tracked_points.string(), "say it of all, or of none, or give --fle"});
  const bool is_known = options.fle_mm || stated > 0;
  if (options.fle_mm)
    for (PointPair& pair : *pairs) pair.fle_mm = *options.fle_mm;
  const auto by_points = register_points(*pairs);
  if (!by_points) {
    Error error = by_points.error();
    error.where = options.tracked_points.string();
    return console.fail(error);
  }

  std::printf("%s %s\n", fitted("point", 16).c_str(), "left over, mm");
  for (std::size_t n = 0; n < pairs->size(); ++n)
    std::printf("%s %.3f\n", shown_name((*pairs)[n].name).c_str(), by_points->residuals_mm[n]);
  std::printf("all              %.3f (FRE, root mean square), which tells nothing of the error elsewhere\n",
              by_points->fre_mm);
  const bool says_nothing = !is_known && by_points->fle_scale < 1e-6;
  if (says_nothing)
    console.warn()(
        "the points fit without any error: they were computed from one another, and nothing is known of how "
        "wrong this is");
  double scale = 1;
  if (!is_known) {
    scale = by_points->fle_scale;
    std::printf("error of a point %.2f mm (FLE, from what is left over; %.2f to %.2f in 95 of 100 cases)\n",
                scale, by_points->least_fle_scale, by_points->most_fle_scale);
  }
  // of the points alone, whatever a surface then does
  Json of_points{{"patient_from_tracker", rows_of(by_points->patient_from_tracker)},
                 {"fre_mm", by_points->fre_mm},
                 {"fle_known", is_known}};
  if (!is_known)
    of_points["fle_mm"] = {by_points->fle_scale, by_points->least_fle_scale, by_points->most_fle_scale};
  Json residuals = Json::array(), targets = Json::array();
  for (std::size_t n = 0; n < pairs->size(); ++n)
    residuals.push_back({{"name", (*pairs)[n].name}, {"mm", by_points->residuals_mm[n]}});
  of_points["points"] = residuals;
  std::vector<Point<Patient>> places;
  for (const std::vector<double>& at : options.targets) places.emplace_back(at[0], at[1], at[2]);
  if (places.empty()) places.push_back(by_points->centroid);
  if (says_nothing)
    places.clear();
  else
    std::printf("\nby these points, a target is wrong by (TRE):\n");
  for (const Point<Patient>& place : places) {
    const ErrorSpread wrong = target_error(*by_points, place, scale);
    std::printf("  at %.1f, %.1f, %.1f%s   %.2f mm (root mean square); below %.2f in 95 of 100 cases\n",
                place.x(), place.y(), place.z(), options.targets.empty() ? " (the points' middle)" : "",
                wrong.rms_mm, wrong.most_mm);
    targets.push_back(
        {{"at_mm", json_of(place.eigen())}, {"tre_rms_mm", wrong.rms_mm}, {"tre_95_mm", wrong.most_mm}});
  }
  of_points["targets"] = targets;
  Json json{{"patient_from_tracker", of_points["patient_from_tracker"]}, {"by_points", of_points}};

  if (!options.surface.empty()) {
    const auto touched = points_of(options.touched);
    if (!touched) return console.fail(touched.error());
    const auto loaded = load_target(options.surface, console);
    if (!loaded) return console.fail(loaded.error());
    const Model& model = *loaded->model;
    const auto segment = std::find_if(model.segments.begin(), model.segments.end(),
                                      [&](const Segment& each) { return each.name == options.structure; });
    if (segment == model.segments.end()) {
      std::string known;
      std::vector<std::string> names;
      for (const Segment& each : model.segments) {
        names.push_back(each.name);
        known += (known.empty() ? "" : ", ") + printable_name(each.name);
      }
      const std::string meant = nearest(options.structure, names);
      return console.fail(
          {ErrorKind::kUsage, "no structure is called \"" + printable_name(options.structure) + "\"",
           "--structure",
           meant.empty() ? "there are: " + known
                         : "perhaps \"" + printable_name(meant) + "\" is meant; there are: " + known});
    }
    // the structure's own, also where it is felt as one with others that it touches
    const auto prepared = prepare_surfaces(*model.labels, {segment->id}, {}, console.progress());
    if (!prepared) return console.fail(prepared.error());
    std::vector<Point<Tracker>> at;
    for (const NamedPoint& point : *touched) at.emplace_back(point.at_mm);
    const auto by_surface =
        register_to_surface(prepared->front().surface, at, by_points->patient_from_tracker,
                            {.tip_radius_mm = options.tip_radius_mm}, console.progress());
    if (!by_surface) {
      Error error = by_surface.error();
      if (error.kind != ErrorKind::kInterrupted) error.where = options.touched.string();
      return console.fail(error);
    }
    const auto trimmed = std::count(by_surface->is_trimmed.begin(), by_surface->is_trimmed.end(), true);
    std::printf("\nthen onto the surface of %s by %zu points, %ld of which, the worst, do not count:\n",
                printable_name(options.structure).c_str(), at.size(), static_cast<long>(trimmed));
    std::printf("  left over %.3f mm (root mean square); moved by %.2f mm and %.2f degrees\n",
                by_surface->rms_mm, by_surface->moved_mm, by_surface->turned_deg);
    json["patient_from_tracker"] = rows_of(by_surface->patient_from_tracker);
    json["surface"] = {{"structure", options.structure},
                       {"points", at.size()},
                       {"trimmed", trimmed},
                       {"rms_mm", by_surface->rms_mm},
                       {"moved_mm", by_surface->moved_mm},
                       {"turned_deg", by_surface->turned_deg},
                       {"hold", by_surface->hold}};
  }
  if (!options.output.empty()) {
    if (const auto written = write_json(options.output, json); !written) return console.fail(written.error());
    console.note("registration: " + options.output.string());
  }
  return kExitOk;
}

}  // namespace

void add_pivot(CLI::App& app, Run& run) {
  auto options = std::make_shared<PivotVerb>();
  CLI::App* verb =
      app.add_subcommand("pivot", "Find a tracked tool's tip from poses in which it turned about its tip");
  verb->add_option("poses", options->poses,
                   "Poses of the tool's markers, tracker from tool: a line for each (16 or 12 numbers of a "
                   "matrix, or x y z and a quaternion), or a sequence of PLUS (.mha)")
      ->required();
  verb->add_option("--transform", options->format.transform,
                   "Of a sequence with several: which, e.g. StylusToTracker");
  verb->add_option("--quaternion", options->quaternion, "Order of a quaternion's numbers")
      ->check(CLI::IsMember({"xyzw", "wxyz"}))
      ->capture_default_str();
  verb->add_option("-o,--output", options->output, "Writes tip and errors (JSON)");
  verb->footer(
      "Keep the tip in a dimple and turn the tool by 30 degrees and more to all sides, for some hundred "
      "poses.\n"
      "Poses that do not agree with the others are left out and told; a tool that hardly turned is "
      "refused.\n\n"
      "Example:\n"
      "  palpate pivot poses.csv -o tip.json");
  verb->callback([options, &run] { run = [options](Console& console) { return pivot(*options, console); }; });
}

void add_register(CLI::App& app, Run& run) {
  auto options = std::make_shared<RegisterVerb>();
  CLI::App* verb = app.add_subcommand(
      "register", "Find where a tracked patient lies in the scan, and how wrong that may be");
  verb->add_option(
          "scan", options->scan_points,
          "Points in the scan, mm, LPS: Slicer's markups (.mrk.json, .fcsv), or lines of name, x, y, z")
      ->required();
  verb->add_option("tracked", options->tracked_points,
                   "The same points as the tracker saw them, mm; a fifth number is the point's error")
      ->required();
  verb->add_option("--fle", options->fle_mm,
                   "How wrong a tracked point is, mm (root mean square); default: from what is left over")
      ->check(number_between(1e-6, 1000));
  verb->add_option("--target", options->targets,
                   "Where the error is wanted: patient coordinates in mm, LPS; may be given several times")
      ->delimiter(',')
      ->expected(3)
      ->check(number_between(-1e6, 1e6))
      ->type_name("X,Y,Z");
  verb->add_option("--surface", options->surface,
                   "Then onto a structure's surface: a data set, a scene file, or a label map");
  verb->add_option("--structure", options->structure, "Which structure");
  verb->add_option("--touched", options->touched,
                   "Where that structure was touched, as the tracker saw it (12 points and more)");
  verb->add_option("--tip-radius", options->tip_radius_mm, "Of the ball it was touched with, mm")
      ->check(number_between(0, 20))
      ->capture_default_str();
  verb->add_option("-o,--output", options->output, "Writes the registration (JSON)");
  verb->footer(
      "Examples:\n"
      "  palpate register scan.mrk.json tracked.csv --target 12,-40,8\n"
      "  palpate register scan.fcsv tracked.csv --surface scene.toml --structure femur --touched traced.csv "
      "-o registration.json\n\n"
      "docs/guide/navigation.md says what the figures mean. Not for clinical use.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return register_verb(*options, console); }; });
}

}  // namespace palpate::app
