#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "apps/command/text.h"
#include "inputs.h"
#include "live_tracker.h"
#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/navigation/pivot.h"
#include "palpate/navigation/point_files.h"
#include "palpate/navigation/registration.h"
#include "palpate/navigation/result_files.h"
#include "palpate/navigation/surface_registration.h"
#include "palpate/surfaces/surfaces.h"
#include "palpation.h"
#include "verb.h"

/// Verbs for tracking: pivot calibration of a tracked tool and registration of the patient, from files or
/// from the stream of a tracker.
namespace palpate::app {
namespace {

constexpr std::size_t kMaxPoints_bytes = std::size_t{1} << 24, kMaxPoses_bytes = std::size_t{1} << 28;

std::string shown_name(const std::string& name) {
  return fitted(printable_name(name), 16);
}

// ---- pivot

struct PivotVerb {
  std::string poses;  // file, or address of a tracker
  std::filesystem::path output;
  StreamOptions stream;
  std::string quaternion = "xyzw";
};

Result<std::vector<Transform<Tracker, TrackedTool>>> poses_of(const PivotVerb& options, Console& console) {
  if (const auto address = stream_named(options.poses)) {
    const auto settings = stream_settings(*address, options.stream);
    if (!settings) return settings.error();
    return collect_pivot(*settings, console);
  }
  const auto text = read_file(options.poses, kMaxPoses_bytes);
  if (!text) return text.error();
  return parse_poses(*text, options.poses, {options.stream.transform, options.quaternion == "wxyz"});
}

int pivot(const PivotVerb& options, Console& console) {
  std::optional<OutputClaim> claim;
  if (!options.output.empty()) {
    auto claimed = claim_output(options.output, std::array{std::filesystem::path(options.poses)});
    if (!claimed) return console.fail(claimed.error());
    claim.emplace(std::move(*claimed));
  }
  const auto poses = poses_of(options, console);
  if (!poses) return console.fail(poses.error());
  const auto found = calibrate_pivot(*poses);
  if (!found) {
    Error error = found.error();
    error.where = printable_name(options.poses);
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
    if (const auto written = write_file(options.output, tip_text(*found)); !written)
      return console.fail(written.error());
    console.note("tip: " + options.output.string());
  }
  return kExitOk;
}

// ---- register

struct RegisterVerb {
  std::filesystem::path scan_points, touched, output;
  std::string tracked_points;  // file, or address of a tracker
  StreamOptions stream;
  std::string surface, structure;
  std::optional<double> fle_mm;
  double tip_radius_mm = 0;
  std::vector<std::vector<double>> targets;
};

// pairs points by name if both files have the same names, otherwise by order
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
                 printable_name(options.tracked_points),
                 "name the points alike in both files, or list as many in the same order"};
  console.note("the points have other names in the two files: paired in their order");
  for (std::size_t n = 0; n < scan.size(); ++n) add(scan[n], tracked[n]);
  return pairs;
}

Result<std::vector<NamedPoint>> points_of(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxPoints_bytes);
  if (!text) return text.error();
  return parse_points(*text, file.string());
}

// touched points, from files or collected live
struct TouchedPlaces {
  std::vector<NamedPoint> points;
  std::vector<double> held_mm;         // RMS distance of the tip samples from their mean, for each point
                                       // collected live
  std::vector<Point<Tracker>> traced;  // points traced on the surface
};
Result<TouchedPlaces> touched_places(const RegisterVerb& options, const std::vector<NamedPoint>& scan,
                                     Console& console) {
  TouchedPlaces out;
  if (!options.touched.empty()) {
    const auto traced = points_of(options.touched);
    if (!traced) return traced.error();
    for (const NamedPoint& point : *traced) out.traced.emplace_back(point.at_mm);
  }
  const auto address = stream_named(options.tracked_points);
  if (!address) {
    auto points = points_of(options.tracked_points);
    if (!points) return points.error();
    out.points = *std::move(points);
    return out;
  }
  const auto settings = stream_settings(*address, options.stream);
  if (!settings) return settings.error();
  if (options.stream.tip.empty())
    return Error{ErrorKind::kUsage, "of a tracked tool its tip has to be known", "--tip",
                 "give what palpate pivot -o has written"};
  const auto tip = read_tip(options.stream.tip);
  if (!tip) return tip.error();
  std::vector<std::string> names;
  for (const NamedPoint& point : scan) names.push_back(point.name);
  const bool traces = !options.surface.empty() && options.touched.empty();
  auto collected = collect_touches(*settings, *tip, names, traces ? options.structure : "", console);
  if (!collected) return collected.error();
  for (std::size_t n = 0; n < names.size(); ++n) {
    out.points.push_back({names[n], collected->points[n].at.eigen(), {}});
    out.held_mm.push_back(collected->points[n].held_mm);
  }
  if (traces) out.traced = std::move(collected->traced);
  return out;
}

// own surface of the structure, even if it is part of a common surface when rendered
Result<Surface> surface_of(const RegisterVerb& options, Console& console) {
  const auto loaded = load_target({options.surface}, console);
  if (!loaded) return loaded.error();
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
    return Error{ErrorKind::kUsage, "no structure is called \"" + printable_name(options.structure) + "\"",
                 "--structure",
                 meant.empty() ? "there are: " + known
                               : "perhaps \"" + printable_name(meant) + "\" is meant; there are: " + known};
  }
  auto prepared = prepare_surfaces(*model.labels, {segment->id}, {}, console.progress());
  if (!prepared) return prepared.error();
  return std::move(prepared->front().surface);
}

void print_points(const RegistrationOutcome& outcome, bool targets_given) {
  const PointRegistration& points = outcome.by_points;
  std::printf("%s %s\n", fitted("point", 16).c_str(), "left over, mm");
  for (std::size_t n = 0; n < outcome.names.size(); ++n)
    std::printf("%s %.3f\n", shown_name(outcome.names[n]).c_str(), points.residuals_mm[n]);
  std::printf("all              %.3f (FRE, root mean square), which tells nothing of the error elsewhere\n",
              points.fre_mm);
  if (!outcome.is_fle_known && outcome.fle_scale)
    std::printf("error of a point %.2f mm (FLE, from what is left over; %.2f to %.2f in 95 of 100 cases)\n",
                points.fle_scale, points.min_fle_scale, points.max_fle_scale);
  if (!outcome.fle_scale) return;
  std::printf("\nby these points, a target is wrong by (TRE):\n");
  for (const Point<Patient>& place : outcome.targets) {
    const ErrorSpread wrong = error_at(rigid_error(points, *outcome.fle_scale), place);
    std::printf("  at %.1f, %.1f, %.1f%s   %.2f mm (root mean square); below %.2f in 95 of 100 cases\n",
                place.x(), place.y(), place.z(), targets_given ? "" : " (the points' middle)", wrong.rms_mm,
                wrong.max_mm);
  }
}

int register_verb(const RegisterVerb& options, Console& console) {
  std::vector<std::filesystem::path> inputs = input_files({options.surface});
  for (const std::filesystem::path& file :
       {options.scan_points, std::filesystem::path(options.tracked_points), options.touched,
        options.stream.tip})
    if (!file.empty()) inputs.push_back(file);
  std::optional<OutputClaim> claim;
  if (!options.output.empty()) {
    auto claimed = claim_output(options.output, inputs);
    if (!claimed) return console.fail(claimed.error());
    claim.emplace(std::move(*claimed));
  }
  const bool is_live = stream_named(options.tracked_points).has_value();
  const bool is_touched = is_live ? !options.touched.empty() && options.surface.empty()
                                  : options.surface.empty() != options.touched.empty();
  if (is_touched || options.surface.empty() != options.structure.empty())
    return console.fail({ErrorKind::kUsage, "a surface needs --surface, --structure and --touched", "",
                         "give all three, or none; live it is traced, and needs no --touched"});

  const auto scan = points_of(options.scan_points);
  if (!scan) return console.fail(scan.error());
  // before points are collected, so that an error does not waste that effort
  std::optional<Surface> surface;
  const auto find_surface = [&]() -> Result<void> {
    auto found = surface_of(options, console);
    if (!found) return found.error();
    surface.emplace(*std::move(found));
    return {};
  };
  if (is_live && !options.surface.empty())
    if (const auto found = find_surface(); !found) return console.fail(found.error());
  const auto touched = touched_places(options, *scan, console);
  if (!touched) return console.fail(touched.error());
  const std::vector<NamedPoint>& tracked = touched->points;
  auto pairs = pair_up(*scan, tracked, options, console);
  if (!pairs) return console.fail(pairs.error());
  const auto stated = std::count_if(tracked.begin(), tracked.end(),
                                    [](const auto& point) { return point.fle_mm.has_value(); });
  if (!options.fle_mm && stated > 0 && stated < std::ssize(tracked))
    return console.fail({ErrorKind::kBadInput,
                         "says of " + std::to_string(stated) + " of " + std::to_string(tracked.size()) +
                             " points how wrong they are",
                         printable_name(options.tracked_points), "say it of all, or of none, or give --fle"});
  if (options.fle_mm)
    for (PointPair& pair : *pairs) pair.fle_mm = *options.fle_mm;
  auto by_points = register_points(*pairs);
  if (!by_points) {
    Error error = by_points.error();
    error.where = printable_name(options.tracked_points);
    return console.fail(error);
  }

  RegistrationOutcome outcome;
  outcome.by_points = *std::move(by_points);
  for (const PointPair& pair : *pairs) outcome.names.push_back(pair.name);
  outcome.held_mm = touched->held_mm;
  outcome.is_fle_known = options.fle_mm || stated > 0;
  outcome.reference = is_live ? options.stream.reference : "";
  for (const std::vector<double>& at : options.targets) outcome.targets.emplace_back(at[0], at[1], at[2]);
  if (outcome.targets.empty()) outcome.targets.push_back(outcome.by_points.centroid);
  if (outcome.is_fle_known)
    outcome.fle_scale = 1;
  else if (outcome.by_points.fle_scale >= 1e-6)
    outcome.fle_scale = outcome.by_points.fle_scale;
  else
    console.warn()(
        "the points fit without any error: they were computed from one another, and nothing is known of how "
        "wrong this is");
  print_points(outcome, !options.targets.empty());

  if (!options.surface.empty()) {
    if (!surface)
      if (const auto found = find_surface(); !found) return console.fail(found.error());
    auto found = register_to_surface(*surface, touched->traced, outcome.by_points.patient_from_tracker,
                                     {.tip_radius_mm = options.tip_radius_mm}, console.progress());
    if (!found) {
      Error error = found.error();
      if (error.kind != ErrorKind::kInterrupted)
        error.where =
            options.touched.empty() ? printable_name(options.tracked_points) : options.touched.string();
      return console.fail(error);
    }
    outcome.surface = {options.structure, *std::move(found)};
    const SurfaceRegistration& onto = outcome.surface->found;
    const auto trimmed = std::count(onto.is_trimmed.begin(), onto.is_trimmed.end(), true);
    std::printf("\nthen onto the surface of %s by %zu points, %ld of which, the worst, do not count:\n",
                printable_name(options.structure).c_str(), touched->traced.size(),
                static_cast<long>(trimmed));
    std::printf("  left over %.3f mm (root mean square); moved by %.2f mm and %.2f degrees\n", onto.rms_mm,
                onto.moved_mm, onto.turned_deg);
  }
  if (!options.output.empty()) {
    if (const auto written = write_file(options.output, registration_text(outcome)); !written)
      return console.fail(written.error());
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
                   "matrix, or x y z and a quaternion), or a sequence of PLUS (.mha); or HOST:PORT of a "
                   "tracker's server (OpenIGTLink; of PLUS: port 18944), live")
      ->required();
  add_stream_options(*verb, options->stream);
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
      "  palpate pivot poses.csv -o tip.json\n"
      "  palpate pivot localhost:18944 --transform StylusToTracker -o tip.json");
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
                   "The same points as the tracker saw them, mm; a fifth number is the point's error. Or "
                   "HOST:PORT of a tracker's server (OpenIGTLink): they are touched now, in their order")
      ->required();
  add_stream_options(*verb, options->stream);
  add_tip_option(*verb, options->stream);
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
  verb->add_option(
      "--touched", options->touched,
      "Where that structure was touched, as the tracker saw it (12 points and more); live: it is "
      "traced now");
  verb->add_option("--tip-radius", options->tip_radius_mm, "Of the ball it was touched with, mm")
      ->check(number_between(0, 20))
      ->capture_default_str();
  verb->add_option("-o,--output", options->output, "Writes the registration (JSON)");
  verb->footer(
      "Examples:\n"
      "  palpate register scan.mrk.json tracked.csv --target 12,-40,8\n"
      "  palpate register scan.fcsv tracked.csv --surface scene.toml --structure femur --touched traced.csv "
      "-o registration.json\n"
      "  palpate register scan.mrk.json localhost:18944 --transform StylusToTracker --reference "
      "ReferenceToTracker\n    --tip tip.json -o registration.json\n\n"
      "docs/guide/navigation.md says what the figures mean. Not for clinical use.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return register_verb(*options, console); }; });
}

}  // namespace palpate::app
