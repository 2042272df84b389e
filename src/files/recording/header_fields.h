#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

#include "palpate/recording/recording.h"

/// The list of the header's and the summary's plain fields, iterated by the writer, by the reader and by the
/// stream between the reader's two processes. `visit(name, field)` receives std::string, bool, int,
/// std::uint32_t, std::uint64_t and double.
namespace palpate::internal {

inline constexpr const char* kFormat = "palpate recording";
/// Incremented when older readers would misinterpret a file: a data set is removed or changes its meaning.
/// Readers keep reading every format from 6 on (docs/reference/versions.md).
inline constexpr std::uint32_t kFormatMajor = 6;
/// Incremented when something is added that older readers can ignore.
inline constexpr std::uint32_t kFormatMinor = 1;

inline constexpr const char* kVirtualClock = "virtual";
inline constexpr const char* kRealClock = "real";

inline constexpr std::size_t kMaxText = 8192;  ///< Maximum size of a header text; bytes
inline constexpr std::size_t kMaxScript = std::size_t{16} << 20;
inline constexpr std::size_t kMaxStructures = 65536;
/// Maximum total size of all structures' and tissues' names; bytes
inline constexpr std::size_t kMaxNames = std::size_t{64} << 20;
inline constexpr std::size_t kMaxProblems = 1000;
inline constexpr std::size_t kMaxMethods = 256;    ///< The method number is a byte
inline constexpr std::size_t kProblemBytes = 512;  ///< Maximum size of one recorded problem; bytes

/// All fields of the header except script and structures: attributes of the group /header.
template <class Header, class Visit>
void visit_header(Header& header, Visit&& visit) {
  visit("palpate_version", header.palpate_version);
  visit("commit", header.commit);
  visit("build_type", header.build_type);
  visit("compiler", header.compiler);
  visit("simd_target", header.simd_target);
  visit("started_utc", header.started_utc);
  visit("data_set", header.data_set);
  visit("scene_title", header.scene_title);
  visit("model_hash", header.model_hash);
  visit("model_version", header.model_version);
  visit("rate_hz", header.rate_hz);
  visit("seed", header.seed);
  visit("device", header.device);
  visit("hand", header.hand);
  visit("simulated", header.simulated);
  visit("devices", header.devices);
  visit("clock", header.clock);
  visit("scheduler", header.scheduler);
  visit("feel", header.haptic_settings);
  visit("tissue_coarsened", header.tissue_cell_factor);
  visit("task", header.task.name);
  visit("task_hash", header.task.hash);
  visit("task_seed", header.task.seed);
}

/// Scalar data sets of the group /summary that count a flag.
template <class Summary, class Visit>
void visit_flag_counts(Summary& summary, Visit&& visit) {
  visit("clamped", summary.clamped, kFlagClamped);
  visit("not_finite", summary.not_finite, kFlagNotFinite);
  visit("outside", summary.outside, kFlagOutside);
  visit("paused", summary.paused, kFlagPaused);
  visit("rotation_ignored", summary.rotation_ignored, kFlagRotationIgnored);
  visit("thermal", summary.thermal, kFlagThermal);
  visit("slewed", summary.slewed, kFlagSlew);
  visit("stale", summary.stale, kFlagStale);
  visit("jumped", summary.jumped, kFlagJump);
  visit("device_faults", summary.device_faults, kFlagDeviceFault);
  visit("halted", summary.halted, kFlagHalted);
  visit("emergency_stopped", summary.emergency_stopped, kFlagEmergencyStop);
  visit("clutched", summary.clutched, kFlagClutched);
  visit("faded", summary.ramped, kFlagRamp);
  visit("blended", summary.blended, kFlagBlend);
  visit("method_missing", summary.method_missing, kFlagMethodMissing);
  visit("inside", summary.inside, kFlagInside);
  visit("wedged", summary.wedged, kFlagWedged);
  visit("ruptured", summary.ruptured, kFlagRuptured);
  visit("passivated", summary.passivated, kFlagPassivity);
  visit("turns_held", summary.rotation_limited, kFlagRotationLimited);
}

/// All scalar data sets of the group /summary.
template <class Summary, class Visit>
void visit_summary(Summary& summary, Visit&& visit) {
  visit("ticks", summary.ticks);
  visit("run_hash", summary.run_hash);
  visit_flag_counts(summary, [&](const char* name, auto& count, TickFlag) { visit(name, count); });
  visit("dropped", summary.dropped);
  visit("skipped", summary.skipped);
}

}  // namespace palpate::internal
