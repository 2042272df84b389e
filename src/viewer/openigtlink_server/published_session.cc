#include "openigtlink_server/published_session.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <chrono>
#include <cmath>
#include <cstring>
#include <span>

#include "palpate/openigtlink/messages.h"
#include "palpate/openigtlink_server/openigtlink_server.h"

namespace palpate::openigtlink_server {
namespace {

constexpr int kMaxAxis_voxels = 65535;

// RAS from LPS
Eigen::Matrix3d ras_from_patient() {
  return Eigen::Vector3d(-1, -1, 1).asDiagonal();
}
Eigen::Vector3d vector_of(const std::array<double, 3>& numbers) {
  return {numbers[0], numbers[1], numbers[2]};
}
Eigen::Matrix3d rotation_of(const std::array<double, 4>& wxyz) {
  const Eigen::Quaterniond turn(wxyz[0], wxyz[1], wxyz[2], wxyz[3]);
  return turn.norm() > 0 ? turn.normalized().toRotationMatrix() : Eigen::Matrix3d::Identity();
}

// "Probe2ToRAS" of the second device
std::string numbered(const char* before, std::size_t device, const char* after = "") {
  return before + (device == 0 ? "" : std::to_string(device + 1)) + after;
}

igtl::ImageGrid image_grid(const GridGeometry& grid, int first_slice, int slices) {
  igtl::ImageGrid out;
  out.dims = {static_cast<std::uint16_t>(grid.dims[0]), static_cast<std::uint16_t>(grid.dims[1]),
              static_cast<std::uint16_t>(slices)};
  const Eigen::Matrix3d steps = grid.direction * grid.spacing_mm.asDiagonal();
  out.steps_mm = ras_from_patient() * steps;
  out.first_mm = ras_from_patient() * (grid.origin.eigen() + first_slice * steps.col(2));
  return out;
}
bool fits_image(const GridGeometry& grid) {
  return std::ranges::all_of(grid.dims, [](int dim) { return dim <= kMaxAxis_voxels; });
}

static_assert(std::endian::native == std::endian::little, "voxels are sent little-endian");
template <class T>
std::span<const std::uint8_t> bytes_of(std::span<const T> values) {
  return {reinterpret_cast<const std::uint8_t*>(values.data()), values.size_bytes()};
}

Message shared(igtl::MessageBytes bytes) {
  return std::make_shared<const igtl::MessageBytes>(std::move(bytes));
}

}  // namespace

std::uint64_t stamp_now() {
  using namespace std::chrono;
  const auto now = duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count();
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  const auto seconds = static_cast<std::uint64_t>(now / kSecond_ns);
  return seconds << 32 | (static_cast<std::uint64_t>(now % kSecond_ns) << 32) / kSecond_ns;
}

PublishedSession::PublishedSession(const ViewerHost& host) : host_(host) {
  for (std::size_t r = 0; r < 3; ++r)
    for (std::size_t c = 0; c < 3; ++c)
      R_WorldPatient_(static_cast<int>(r), static_cast<int>(c)) = host.scene().world_from_patient[r][c];
}

igtl::MessageBytes PublishedSession::frame(Structures& structures) const {
  std::array<double, kMaxDevices> stiffness_N_per_mm{};
  const TickRecord tick = host_.snapshot(stiffness_N_per_mm);
  const Eigen::Matrix3d R_RasWorld =
      ras_from_patient() * (rotation_of(tick.rotation_applied_wxyz) * R_WorldPatient_).transpose();
  const std::uint64_t stamp = stamp_now();
  igtl::MessageBytes out;
  const auto add = [&out](const igtl::MessageBytes& message) {
    out.insert(out.end(), message.begin(), message.end());
  };
  const auto devices = static_cast<std::size_t>(std::clamp(tick.devices, 0, kMaxDevices));
  for (std::size_t d = 0; d < devices; ++d) {
    const DeviceTick& device = tick.device[d];
    const Eigen::Vector3d tip_mm = ras_from_patient() * vector_of(device.tip_patient_mm);
    const Eigen::Vector3d force_N = R_RasWorld * vector_of(device.force_N);
    // before its first pose a device has none
    if (!tip_mm.allFinite() || !force_N.allFinite()) continue;
    add(igtl::transform_message({numbered("Probe", d, "ToRAS"), stamp},
                                R_RasWorld * rotation_of(device.orientation_wxyz), tip_mm));
    add(igtl::transform_message({numbered("Force", d), stamp}, Eigen::Matrix3d::Identity(), force_N));
    add(igtl::line_message({numbered("ForceArrow", d), stamp}, tip_mm,
                           tip_mm + kForceArrow_mm_per_N * force_N));
    const auto touched = std::ranges::find(host_.scene().structures, device.label, &ViewedStructure::label);
    const bool is_touched = device.label != 0 && touched != host_.scene().structures.end();
    const std::string name = is_touched ? touched->name : "none";
    if (structures[d] == name) continue;
    structures[d] = name;
    add(igtl::string_message({numbered("Structure", d), stamp}, name));
  }
  return out;
}

bool PublishedSession::is_stopped() const {
  return host_.state().stop.has_value();
}

Message PublishedSession::status() const {
  const bool stopped = is_stopped();
  return shared(igtl::status_message({"palpate", stamp_now()},
                                     stopped ? igtl::StatusCode::kEmergency : igtl::StatusCode::kOk,
                                     stopped ? "force stopped" : "force enabled"));
}

std::optional<int> PublishedSession::slice_index() const {
  std::array<double, kMaxDevices> stiffness_N_per_mm{};
  const TickRecord tick = host_.snapshot(stiffness_N_per_mm);
  const GridGeometry& grid = host_.scene().labels->geometry();
  const Eigen::Vector3d from_origin = vector_of(tick.device[0].tip_patient_mm) - grid.origin.eigen();
  const double k = grid.direction.inverse().row(2).dot(from_origin) / grid.spacing_mm[2];
  if (!fits_image(grid) || !(k > -0.5 && k < grid.dims[2] - 0.5)) return {};
  return static_cast<int>(std::lround(k));
}

Message PublishedSession::slice(int index) const {
  const ViewedScene& scene = host_.scene();
  const GridGeometry& grid = scene.labels->geometry();
  const auto voxels = static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]);
  const igtl::Title title{kSliceName, stamp_now()};
  if (scene.scan != nullptr) {
    const std::span<const float> values(
        scene.scan->voxels().data() + static_cast<std::size_t>(index) * voxels, voxels);
    return shared(
        igtl::image_message(title, image_grid(grid, index, 1), igtl::VoxelType::kFloat32, bytes_of(values)));
  }
  std::vector<LabelId> values(voxels);
  const auto labels = host_.labels();
  for (int j = 0; j < grid.dims[1]; ++j)
    labels->copy_row(0, j, index, grid.dims[0],
                     values.data() + static_cast<std::ptrdiff_t>(j) * grid.dims[0]);
  return shared(igtl::image_message(title, image_grid(grid, index, 1), igtl::VoxelType::kUint16,
                                    bytes_of(std::span<const LabelId>(values))));
}

Message PublishedSession::labels(const Bricks<LabelId>& labels, const Bricks<LabelId>* before) {
  const igtl::Title title{kLabelsName, stamp_now()};
  const GridGeometry& grid = labels.geometry();
  if (!fits_image(grid))
    return shared(igtl::status_message(title, igtl::StatusCode::kNotFound,
                                       "the grid is larger than an IMAGE message can describe"));
  if (before != nullptr) {
    const VoxelBox box = box_of_changes(*before, labels);
    if (box.voxel_count() == 0) return nullptr;
    std::vector<LabelId> values(box.voxel_count());
    igtl::SubVolume part;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      part.first[axis] = static_cast<std::uint16_t>(box.first[axis]);
      part.dims[axis] = static_cast<std::uint16_t>(box.size[axis]);
    }
    LabelId* row = values.data();
    for (int k = 0; k < box.size[2]; ++k)
      for (int j = 0; j < box.size[1]; ++j, row += box.size[0])
        labels.copy_row(box.first[0], box.first[1] + j, box.first[2] + k, box.size[0], row);
    return shared(igtl::image_message(title, image_grid(grid, 0, grid.dims[2]), part,
                                      igtl::VoxelType::kUint16, bytes_of(std::span<const LabelId>(values))));
  }
  const Volume<LabelId> dense = labels.dense();
  return shared(igtl::image_message(title, image_grid(grid, 0, grid.dims[2]), igtl::VoxelType::kUint16,
                                    bytes_of(std::span<const LabelId>(dense.voxels()))));
}

Message PublishedSession::label_list() const {
  constexpr int kMaxValue = 255;  // largest value of the field
  const igtl::ImageGrid grid =
      image_grid(host_.scene().labels->geometry(), 0, host_.scene().labels->geometry().dims[2]);
  std::vector<igtl::ListedLabel> listed;
  for (const ViewedStructure& structure : host_.scene().structures)
    if (structure.label <= kMaxValue)
      listed.push_back({structure.name,
                        kLabelsName,
                        static_cast<std::uint8_t>(structure.label),
                        {structure.colour.r, structure.colour.g, structure.colour.b, 255},
                        grid.dims});
  return shared(igtl::label_list_message({"palpate", stamp_now()}, listed));
}

Message PublishedSession::image_list() const {
  const ViewedScene& scene = host_.scene();
  const igtl::ImageGrid grid = image_grid(scene.labels->geometry(), 0, 1);
  const igtl::ListedImage listed{kSliceName,
                                 scene.modality == "ct"   ? "CT"
                                 : scene.modality == "mr" ? "MR"
                                                          : "",
                                 grid.dims,
                                 scene.scan ? igtl::VoxelType::kFloat32 : igtl::VoxelType::kUint16};
  return shared(igtl::image_list_message({"palpate", stamp_now()}, std::span(&listed, 1)));
}

}  // namespace palpate::openigtlink_server
