#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "palpate/base/result.h"
#include "palpate/link/viewer_server.h"

/// The texts that the server sends (docs/reference/viewer-protocol.md).
namespace palpate::link {

/// What a viewer may do.
enum class Role { kView, kControl };
std::string_view name_of(Role role);

/// How the voxels of the scene are sent, found once.
struct VolumeFacts {
  std::string hash;  ///< in the volumes' addresses
  double scale = 1, offset = 0;
  std::array<double, 2> range{0, 0};  ///< of the scan's finite voxels
  bool wide_labels = false;           ///< uint16
};

/// 16 lower-case hexadecimal digits.
std::string hash_text(std::uint64_t hash);

std::string scene_json(const ViewedScene& scene, const ViewedState& state, const VolumeFacts& facts,
                       Role role);

/// @param holder  the number of the viewer that moves the tip, 0 where none does
/// @param reader  the number of the viewer that gets it, from 1; 0 for none of them
std::string state_json(const ViewedState& state, int viewers, std::uint32_t holder, std::uint32_t reader);

/// To 0.01 mm.
std::string navigation_json(const ViewedNavigation& navigation);
std::string welcome_json(Role role);
/// @param first  number of the first of them, from 0
std::string sweeps_json(std::uint64_t first, std::span<const SweepRecord> sweeps);
std::string done_json(std::int64_t id);
std::string asked_json(std::int64_t id);
std::string refused_json(std::int64_t id, const Error& error);

}  // namespace palpate::link
