#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <vector>

#include "apps/command/text.h"
#include "input_files.h"
#include "live_tracker.h"
#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/navigation/point_files.h"
#include "palpate/navigation/registration.h"
#include "palpate/navigation/result_files.h"
#include "palpate/navigation/surface_registration.h"
#include "palpate/surfaces/surfaces.h"
#include "scene_options.h"
#include "verb.h"

/// Registration of the patient by points and a surface, from files or from the stream of a tracker.
namespace palpate::app {
namespace {

constexpr std::size_t kMaxPoints_bytes = std::size_t{1} << 24;

std::string shown_name(const std::string& name) {
  return pad_or_truncate(printable_name(name), 16);
}

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
  const auto add = [&](const NamedPoint& in_scan, const NamedPoint& observed) {
    pairs.push_back({in_scan.name, Point<Patient>(in_scan.at_mm), Point<Tracker>(observed.at_mm),
                     observed.fle_mm.value_or(1)});
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
    return Error{
        ErrorKind::kBadInput,
        "has " + std::to_string(tracked.size()) + " points, but the scan has " + std::to_string(scan.size()) +
            ", with other names",
        printable_name(options.tracked_points),
        "give the points the same names in both files, or the same number of points in the same order"};
  console.note("the names of the points differ between the two files: points are paired by their order");
  for (std::size_t n = 0; n < scan.size(); ++n) add(scan[n], tracked[n]);
  return pairs;
}

Result<std::vector<NamedPoint>> points_of(const std::filesystem::path& file) {
  const auto text = read_file(file, kMaxPoints_bytes);
  if (!text) return text.error();
  return parse_points(*text, file.string());
}

// touched points, from files or collected live
struct TouchedPoints {
  std::vector<NamedPoint> points;
  std::vector<double> spread_mm;       // RMS distance of the tip samples from their mean, for each point
                                       // collected live
  std::vector<Point<Tracker>> traced;  // points traced on the surface
};
Result<TouchedPoints> touched_points(const RegisterVerb& options, const std::vector<NamedPoint>& scan,
                                     Console& console) {
  TouchedPoints out;
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
    return Error{ErrorKind::kUsage, "the position of the tool's tip is needed", "--tip",
                 "give the file written by palpate pivot -o"};
  const auto tip = read_tip(options.stream.tip);
  if (!tip) return tip.error();
  std::vector<std::string> names;
  for (const NamedPoint& point : scan) names.push_back(point.name);
  const bool traces = !options.surface.empty() && options.touched.empty();
  auto collected = collect_touches(*settings, *tip, names, traces ? options.structure : "", console);
  if (!collected) return collected.error();
  for (std::size_t n = 0; n < names.size(); ++n) {
    out.points.push_back({names[n], collected->points[n].at.eigen(), {}});
    out.spread_mm.push_back(collected->points[n].spread_mm);
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
    const std::string meant = closest_match(options.structure, names);
    return Error{ErrorKind::kUsage, "no structure is called \"" + printable_name(options.structure) + "\"",
                 "--structure",
                 meant.empty() ? "there are: " + known
                               : "did you mean \"" + printable_name(meant) + "\"? There are: " + known};
  }
  auto prepared = prepare_surfaces(*model.labels, {segment->id}, {}, console.progress());
  if (!prepared) return prepared.error();
  return std::move(prepared->front().surface);
}

void print_points(const RegistrationOutcome& outcome, bool declared_targets) {
  const PointRegistration& points = outcome.by_points;
  std::printf("%s %s\n", pad_or_truncate("point", 16).c_str(), "residual, mm");
  for (std::size_t n = 0; n < outcome.names.size(); ++n)
    std::printf("%s %.3f\n", shown_name(outcome.names[n]).c_str(), points.residuals_mm[n]);
  std::printf("all              %.3f (FRE, root mean square); it does not predict the error elsewhere\n",
              points.fre_mm);
  if (!outcome.is_fle_known && outcome.fle_scale)
    std::printf(
        "error of a point %.2f mm (FLE, estimated from the residuals; %.2f to %.2f in 95 of 100 cases)\n",
        points.fle_scale, points.min_fle_scale, points.max_fle_scale);
  if (!outcome.fle_scale) return;
  std::printf("\nexpected target error with these points (TRE):\n");
  for (const Point<Patient>& position : outcome.targets) {
    const ErrorSpread wrong = error_at(rigid_error(points, *outcome.fle_scale), position);
    std::printf("  at %.1f, %.1f, %.1f%s   %.2f mm (root mean square); below %.2f in 95 of 100 cases\n",
                position.x(), position.y(), position.z(), declared_targets ? "" : " (centroid of the points)",
                wrong.rms_mm, wrong.max_mm);
  }
}

// an error in the combination of the options that concern a surface
Result<void> check_surface_options(const RegisterVerb& options, bool is_live) {
  const bool is_touched = is_live ? !options.touched.empty() && options.surface.empty()
                                  : options.surface.empty() != options.touched.empty();
  if (is_touched || options.surface.empty() != options.structure.empty())
    return Error{
        ErrorKind::kUsage, "a surface needs --surface, --structure and --touched", "",
        "give all three, or none; with a live tracker the surface is traced, and --touched is not needed"};
  return {};
}

Result<std::optional<OutputClaim>> claim_output_of(const RegisterVerb& options) {
  if (options.output.empty()) return std::optional<OutputClaim>();
  std::vector<std::filesystem::path> inputs = input_files({options.surface});
  for (const std::filesystem::path& file :
       {options.scan_points, std::filesystem::path(options.tracked_points), options.touched,
        options.stream.tip})
    if (!file.empty()) inputs.push_back(file);
  auto claimed = claim_output(options.output, inputs);
  if (!claimed) return claimed.error();
  return std::optional<OutputClaim>(std::move(*claimed));
}

// registers by the points alone; `outcome.surface` stays empty
Result<RegistrationOutcome> register_by_points(const RegisterVerb& options,
                                               const std::vector<NamedPoint>& scan,
                                               const TouchedPoints& touched, bool is_live, Console& console) {
  const std::vector<NamedPoint>& tracked = touched.points;
  auto pairs = pair_up(scan, tracked, options, console);
  if (!pairs) return pairs.error();
  const auto with_error = std::count_if(tracked.begin(), tracked.end(),
                                        [](const auto& point) { return point.fle_mm.has_value(); });
  if (!options.fle_mm && with_error > 0 && with_error < std::ssize(tracked))
    return Error{ErrorKind::kBadInput,
                 "gives the error of only " + std::to_string(with_error) + " of " +
                     std::to_string(tracked.size()) + " points",
                 printable_name(options.tracked_points),
                 "give the error of all points, or of none, or give --fle"};
  if (options.fle_mm)
    for (PointPair& pair : *pairs) pair.fle_mm = *options.fle_mm;
  auto by_points = register_points(*pairs);
  if (!by_points) {
    Error error = by_points.error();
    error.where = printable_name(options.tracked_points);
    return error;
  }

  RegistrationOutcome outcome;
  outcome.by_points = *std::move(by_points);
  for (const PointPair& pair : *pairs) outcome.names.push_back(pair.name);
  outcome.spread_mm = touched.spread_mm;
  outcome.is_fle_known = options.fle_mm || with_error > 0;
  outcome.reference = is_live ? options.stream.reference : "";
  for (const std::vector<double>& at : options.targets) outcome.targets.emplace_back(at[0], at[1], at[2]);
  if (outcome.targets.empty()) outcome.targets.push_back(outcome.by_points.centroid);
  if (outcome.is_fle_known)
    outcome.fle_scale = 1;
  else if (outcome.by_points.fle_scale >= 1e-6)
    outcome.fle_scale = outcome.by_points.fle_scale;
  else
    console.warn()(
        "the points fit without any error, so they were computed from each other: the error of the "
        "registration is unknown");
  return outcome;
}

Result<SurfaceRegistration> refine_on_surface(const RegisterVerb& options, const Surface& surface,
                                              const TouchedPoints& touched,
                                              const RegistrationOutcome& outcome, Console& console) {
  auto found = register_to_surface(surface, touched.traced, outcome.by_points.patient_from_tracker,
                                   {.tip_radius_mm = options.tip_radius_mm}, console.progress());
  if (found) return found;
  Error error = found.error();
  if (error.kind != ErrorKind::kInterrupted)
    error.where = options.touched.empty() ? printable_name(options.tracked_points) : options.touched.string();
  return error;
}

void print_refinement(const RegisterVerb& options, const SurfaceRegistration& onto, std::size_t traced) {
  const auto trimmed = std::count(onto.is_trimmed.begin(), onto.is_trimmed.end(), true);
  std::printf("\nrefined on the surface of %s with %zu points, without the %ld worst:\n",
              printable_name(options.structure).c_str(), traced, static_cast<long>(trimmed));
  std::printf("  residual %.3f mm (root mean square); moved by %.2f mm and %.2f degrees\n", onto.rms_mm,
              onto.moved_mm, onto.turned_deg);
}

int register_verb(const RegisterVerb& options, Console& console) {
  const auto claim = claim_output_of(options);
  if (!claim) return console.fail(claim.error());
  const bool is_live = stream_named(options.tracked_points).has_value();
  if (const auto checked = check_surface_options(options, is_live); !checked)
    return console.fail(checked.error());

  const auto scan = points_of(options.scan_points);
  if (!scan) return console.fail(scan.error());
  std::optional<Surface> surface;
  const auto find_surface = [&]() -> Result<void> {
    if (options.surface.empty() || surface) return {};
    auto found = surface_of(options, console);
    if (!found) return found.error();
    surface.emplace(*std::move(found));
    return {};
  };
  // before points are collected, so that an error does not waste that effort
  if (is_live)
    if (const auto found = find_surface(); !found) return console.fail(found.error());
  const auto touched = touched_points(options, *scan, console);
  if (!touched) return console.fail(touched.error());
  auto outcome = register_by_points(options, *scan, *touched, is_live, console);
  if (!outcome) return console.fail(outcome.error());
  print_points(*outcome, !options.targets.empty());

  if (const auto found = find_surface(); !found) return console.fail(found.error());
  if (surface) {
    auto refined = refine_on_surface(options, *surface, *touched, *outcome, console);
    if (!refined) return console.fail(refined.error());
    print_refinement(options, *refined, touched->traced.size());
    outcome->surface = {options.structure, *std::move(refined)};
  }
  if (!options.output.empty()) {
    if (const auto written = write_file(options.output, registration_text(*outcome)); !written)
      return console.fail(written.error());
    console.note("registration: " + options.output.string());
  }
  return kExitOk;
}

}  // namespace

void add_register(CLI::App& app, Run& run) {
  auto options = std::make_shared<RegisterVerb>();
  CLI::App* verb =
      app.add_subcommand("register", "Register a tracked patient to the scan, with an error estimate");
  verb->add_option(
          "scan", options->scan_points,
          "Points in the scan, mm, LPS: Slicer's markups (.mrk.json, .fcsv), or lines of name, x, y, z")
      ->required();
  verb->add_option(
          "tracked", options->tracked_points,
          "The same points measured by the tracker, mm; an optional fifth value is the error of the point. "
          "Or HOST:PORT of a live tracking server (OpenIGTLink): touch the points in their order")
      ->required();
  add_stream_options(*verb, options->stream);
  add_tip_option(*verb, options->stream);
  verb->add_option(
          "--fle", options->fle_mm,
          "Error of a tracked point (FLE), mm (root mean square); default: estimated from the residuals")
      ->check(number_between(1e-6, 1000));
  verb->add_option("--target", options->targets,
                   "Target whose error is to be estimated: patient coordinates in mm, LPS; may be repeated")
      ->delimiter(',')
      ->expected(3)
      ->check(number_between(-1e6, 1e6))
      ->type_name("X,Y,Z");
  verb->add_option("--surface", options->surface,
                   "Refine the registration on a surface of this data set, scene file or label map");
  verb->add_option("--structure", options->structure, "Structure whose surface is used");
  verb->add_option(
      "--touched", options->touched,
      "Points on that surface measured by the tracker (12 or more); with a live server it is traced instead");
  verb->add_option("--tip-radius", options->tip_radius_mm,
                   "Radius of the ball at the tip that touched the surface, mm")
      ->check(number_between(0, 20))
      ->capture_default_str();
  verb->add_option("-o,--output", options->output, "File to write the registration to (JSON)");
  verb->footer(
      "Examples:\n"
      "  palpate register scan.mrk.json tracked.csv --target 12,-40,8\n"
      "  palpate register scan.fcsv tracked.csv --surface scene.toml --structure femur --touched traced.csv "
      "-o registration.json\n"
      "  palpate register scan.mrk.json localhost:18944 --transform StylusToTracker --reference "
      "ReferenceToTracker\n"
      "    --tip tip.json -o registration.json\n\n"
      "docs/guide/navigation.md explains the figures. Not for clinical use.");
  verb->callback(
      [options, &run] { run = [options](Console& console) { return register_verb(*options, console); }; });
}

}  // namespace palpate::app
