#include "palpate/navigation/pivot.h"

#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "input_files.h"
#include "live_tracker.h"
#include "palpate/base/file.h"
#include "palpate/base/printable.h"
#include "palpate/navigation/point_files.h"
#include "palpate/navigation/result_files.h"
#include "scene_options.h"
#include "verb.h"

/// Pivot calibration of a tracked tool, from a file or from the stream of a tracker.
namespace palpate::app {
namespace {

constexpr std::size_t kMaxPoses_bytes = std::size_t{1} << 28;

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
  std::printf("tip in the tracker's frame  %.3f, %.3f, %.3f mm\n", found->pivot.x(), found->pivot.y(),
              found->pivot.z());
  std::printf("residual                    %.3f mm (root mean square of %d poses)\n", found->rms_mm,
              found->used);
  std::printf("error of the tip            %.3f mm (root mean square, expected)\n", found->tip_error_mm);
  std::printf("rotation                    %.1f degrees about the axis of least rotation\n", found->turn_deg);
  std::printf("outliers                    %d of %zu poses, left out\n", left_out, poses->size());
  if (!options.output.empty()) {
    if (const auto written = write_file(options.output, tip_text(*found)); !written)
      return console.fail(written.error());
    console.note("tip: " + options.output.string());
  }
  return kExitOk;
}

}  // namespace

void add_pivot(CLI::App& app, Run& run) {
  auto options = std::make_shared<PivotVerb>();
  CLI::App* verb = app.add_subcommand("pivot", "Pivot calibration: find the tip of a tracked tool");
  verb->add_option("poses", options->poses,
                   "Poses of the tool's markers (tracker from tool): a file with one pose per line (matrix "
                   "of 16 or 12 numbers, or x y z and a quaternion), a PLUS sequence (.mha), or a live "
                   "tracking server as HOST:PORT (OpenIGTLink; port 18944 for PLUS)")
      ->required();
  add_stream_options(*verb, options->stream);
  verb->add_option("--quaternion", options->quaternion, "Order of the components of quaternions")
      ->check(CLI::IsMember({"xyzw", "wxyz"}))
      ->capture_default_str();
  verb->add_option("-o,--output", options->output, "File to write the tip and its error to (JSON)");
  verb->footer(
      "Keep the tip in a dimple and tilt the tool by 30 degrees or more in all directions, for some hundred\n"
      "poses. Outliers are left out and counted; poses with too little rotation are refused.\n\n"
      "Example:\n"
      "  palpate pivot poses.csv -o tip.json\n"
      "  palpate pivot localhost:18944 --transform StylusToTracker -o tip.json");
  verb->callback([options, &run] { run = [options](Console& console) { return pivot(*options, console); }; });
}

}  // namespace palpate::app
