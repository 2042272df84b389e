#include "server/volume_pictures.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <chrono>
#include <cmath>
#include <exception>
#include <limits>
#include <utility>

#include "palpate/base/for_each_index.h"
#include "palpate/server/ordinary_thread.h"
#include "server/pose_message.h"
#include "server/volume_payload.h"
#include "server/wire_writer.h"

namespace palpate::server {
namespace {

constexpr int kLowestPriority = 19;
constexpr int kMinSide = 16, kMaxSide = 2048, kMaxPixels = 3 << 20;
/// Maximum magnitude of any number in a query; mm. Far beyond any patient.
constexpr double kMax_mm = 1e5;
constexpr double kMinPixel_mm = 1e-5;
/// Time after the last request for which prepared data are cached.
constexpr auto kRetainedFor = std::chrono::seconds(60);
constexpr std::size_t kHead_bytes = 24;
/// Fastest compression level: latency matters more than size.
constexpr int kGzipLevel = 1;

/// Removes and returns the part of a text before a separator.
std::string_view read_part(std::string_view& text, char separator) {
  const std::string_view part = text.substr(0, text.find(separator));
  text.remove_prefix(std::min(text.size(), part.size() + 1));
  return part;
}

std::optional<std::vector<double>> numbers_in(std::string_view text) {
  std::vector<double> numbers;
  while (!text.empty()) {
    const std::string_view part = read_part(text, ',');
    double number = 0;
    const auto [end, failed] = std::from_chars(part.data(), part.data() + part.size(), number);
    if (failed != std::errc() || end != part.data() + part.size() || !(std::abs(number) <= kMax_mm) ||
        numbers.size() == 16)
      return std::nullopt;
    numbers.push_back(number);
  }
  return numbers;
}

template <class T>
T three(const std::vector<double>& numbers, std::size_t from) {
  return T(numbers[from], numbers[from + 1], numbers[from + 2]);
}

/// Parses width, height; upper left corner of the upper left pixel; pixel vectors to the right and down; eye.
bool take_view(const std::vector<double>& numbers, PictureKey& key) {
  if (numbers.size() != 11 && numbers.size() != 14) return false;
  VolumeCamera& camera = key.camera;
  const double width = numbers[0], height = numbers[1];
  if (width != std::floor(width) || height != std::floor(height) || width < kMinSide || height < kMinSide ||
      width > kMaxSide || height > kMaxSide || width * height > kMaxPixels)
    return false;
  camera.width_px = static_cast<int>(width);
  camera.height_px = static_cast<int>(height);
  const auto corner = three<Point<Patient>>(numbers, 2);
  const auto across = three<Vector<Patient>>(numbers, 5), down = three<Vector<Patient>>(numbers, 8);
  if (across.norm() < kMinPixel_mm || down.norm() < kMinPixel_mm) return false;
  // pixels have to be square, up to the rounding of the picture's size
  if (std::abs(across.norm() / down.norm() - 1) > 0.05 ||
      std::abs(across.normalized().dot(down.normalized())) > 1e-3)
    return false;
  camera.right = across.normalized();
  camera.down = (down - camera.right * down.dot(camera.right)).normalized();
  camera.width_mm = across.norm() * width;
  camera.focus = corner + across * (0.5 * width) + down * (0.5 * height);
  if (numbers.size() == 14) {
    camera.eye_mm = (camera.focus - three<Point<Patient>>(numbers, 11)).dot(camera.into());
    if (!(camera.eye_mm >= kMinPixel_mm)) return false;
  }
  return true;
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return -1;
}

/// Parses colour and opacity of the first structures, two hexadecimal digits per component.
bool parse_appearances(std::string_view text, std::size_t structures, PictureKey& key) {
  if (text.size() % 8 != 0 || text.size() / 8 > structures) return false;
  for (std::size_t n = 0; n < text.size() / 8; ++n) {
    std::array<int, 4> bytes{};
    for (std::size_t b = 0; b < 4; ++b) {
      const int high = hex_digit(text[8 * n + 2 * b]), low = hex_digit(text[8 * n + 2 * b + 1]);
      if (high < 0 || low < 0) return false;
      bytes[b] = 16 * high + low;
    }
    const auto byte = [&](std::size_t b) { return static_cast<std::uint8_t>(bytes[b]); };
    key.colours.push_back({byte(0), byte(1), byte(2)});
    key.opacities.push_back(bytes[3] / 255.0);
  }
  return true;
}

bool take_cut(const std::vector<double>& numbers, PictureKey& key) {
  if (numbers.size() != 6) return false;
  const auto away = three<Vector<Patient>>(numbers, 3);
  if (away.norm() < kMinPixel_mm) return false;
  key.clip = ClipPlane{three<Point<Patient>>(numbers, 0), away};
  return true;
}

bool are_equal(const std::vector<StructureAppearance>& one, const std::vector<StructureAppearance>& other) {
  return std::equal(one.begin(), one.end(), other.begin(), other.end(),
                    [](const StructureAppearance& a, const StructureAppearance& b) {
                      return a.colour == b.colour && a.opacity == b.opacity;
                    });
}

}  // namespace

std::optional<PictureKey> parse_picture_query(std::string_view query, std::size_t structures) {
  PictureKey key;
  bool has_view = false, has_appearances = false, has_cut = false;
  while (!query.empty()) {
    std::string_view value = read_part(query, '&');
    const std::string_view name = read_part(value, '=');
    bool is_good = false;
    if (name == "looks" && !std::exchange(has_appearances, true)) {
      is_good = parse_appearances(value, structures, key);
    } else if (const auto numbers = numbers_in(value)) {
      if (name == "view" && !std::exchange(has_view, true)) is_good = take_view(*numbers, key);
      if (name == "cut" && !std::exchange(has_cut, true)) is_good = take_cut(*numbers, key);
    }
    if (!is_good) return std::nullopt;
  }
  return has_view ? std::optional(std::move(key)) : std::nullopt;
}

PictureStore::Appearances::Appearances(const ViewedScene& scene) {
  for (const ViewedStructure& structure : scene.structures) {
    const auto& tissues = scene.tissues;
    const bool is_known =
        structure.tissue >= 0 && static_cast<std::size_t>(structure.tissue) < tissues.size();
    const std::size_t end = std::size_t{structure.label} + 1;
    of_label.resize(std::max(of_label.size(), end));
    index_of.resize(of_label.size());
    of_label[structure.label] = {structure.colour,
                                 is_known ? tissues[static_cast<std::size_t>(structure.tissue)].opacity : 1};
    label_of.push_back(structure.label);
    // a viewer cannot distinguish more structures in a byte
    if (label_of.size() <= std::numeric_limits<std::uint8_t>::max())
      index_of[structure.label] = static_cast<std::uint8_t>(label_of.size());
  }
}

PictureStore::PictureStore(const ViewerHost& host)
    : host_(host), appearances_(host.scene()), labels_(host.scene().labels) {
  thread_ = std::thread([this] {
    use_ordinary_priority("viewer-pictures");
    // helper threads inherit the priority
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), kLowestPriority);
    work();
  });
}

PictureStore::~PictureStore() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  work_available_.notify_one();
  thread_.join();
}

void PictureStore::request(PictureKey key, std::weak_ptr<const void> requester,
                           std::function<void(Payload)> then) {
  std::optional<QueuedRequest> dropped;
  {
    const std::lock_guard lock(mutex_);
    if (queue_.size() >= kMaxWaiting) {
      dropped = std::move(queue_.front());
      queue_.pop_front();
    }
    queue_.push_back({std::move(key), std::move(requester), std::move(then)});
  }
  work_available_.notify_one();
  if (dropped) dropped->then(nullptr);
}

void PictureStore::work() {
  while (true) {
    std::unique_lock lock(mutex_);
    const auto is_due = [this] { return stop_ || !queue_.empty(); };
    if (renderer_ && !work_available_.wait_for(lock, kRetainedFor, is_due)) {
      renderer_.reset();
      prepared_.clear();
    }
    work_available_.wait(lock, is_due);
    if (stop_) return;
    const QueuedRequest request = std::move(queue_.front());
    queue_.pop_front();
    lock.unlock();

    if (request.requester.expired()) continue;
    const Payload payload = try_render(request.key);
    if (stop_) continue;
    // an exception from the callback is dropped; the connection that waits runs into its time limit
    try {
      request.then(payload);
    } catch (const std::exception&) {
    }
  }
}

// a failure affects this request only
PictureStore::Payload PictureStore::try_render(const PictureKey& key) try {
  if (!prepare(key)) return nullptr;
  Payload plain = render(key);
  return key.gzip ? gzip(*plain, stop_, kGzipLevel) : plain;
} catch (const std::exception&) {
  return nullptr;
}

bool PictureStore::prepare(const PictureKey& key) {
  if (labels_->geometry().voxel_count() > kMaxVoxels) return false;
  if (key.redaction != nullptr && !redacted_) redacted_.emplace(*key.redaction, host_.scene());
  const Appearances& defaults = key.redaction != nullptr ? redacted_->appearances : appearances_;
  std::vector<StructureAppearance> appearances = defaults.of_label;
  for (std::size_t n = 0; n < key.colours.size(); ++n)
    appearances[defaults.label_of[n]] = {key.colours[n], key.opacities[n]};
  if (!appearances.empty()) appearances[0].opacity = 0;
  // the deformation of tissue reveals its structure
  const auto labels = key.redaction != nullptr ? redacted_->cuts.of(host_.labels()) : host_.visible_labels();
  // nothing prepared is reused between original and redacted labels: the time for the update would reveal how
  // much differs
  if (renderer_ && prepared_for_ == key.redaction && are_equal(appearances, prepared_)) {
    const VoxelBox changed = box_of_changes(*labels_, *labels);
    if (changed.voxel_count() > 0) renderer_->change(*labels, changed);
    labels_ = labels;
    return true;
  }
  labels_ = labels;
  renderer_.reset();
  const Progress progress({}, &stop_);
  auto made = VolumeRenderer::make(*labels_, appearances, std::max(1, processors() - 1), progress);
  if (!made) return false;
  renderer_ = std::move(*made);
  prepared_ = std::move(appearances);
  prepared_for_ = key.redaction;
  return true;
}

PictureStore::Payload PictureStore::render(const PictureKey& key) {
  const VolumeCamera& camera = key.camera;
  const auto pixels = static_cast<std::size_t>(camera.width_px) * static_cast<std::size_t>(camera.height_px);
  rgb_.resize(3 * pixels);
  depth_mm_.resize(pixels);
  VolumeStyle style;
  style.clip = key.clip;
  renderer_->render(camera, style, rgb_, depth_mm_);

  double min_depth = std::numeric_limits<double>::infinity(), max_depth = -min_depth;
  for (const float depth : depth_mm_)
    if (std::isfinite(depth))
      min_depth = std::min<double>(min_depth, depth), max_depth = std::max<double>(max_depth, depth);
  if (!(max_depth >= min_depth)) min_depth = max_depth = 0;
  constexpr double kDepthSteps = 65535;

  const std::vector<std::uint8_t>& structure_indices =
      key.redaction != nullptr ? redacted_->appearances.index_of : appearances_.index_of;
  // the rendered surface lies at half coverage: the structure is looked up behind it
  const GridGeometry& grid = labels_->geometry();
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const Point<Patient> eye =
      camera.is_parallel() ? Point<Patient>() : camera.focus - camera.into() * camera.eye_mm;
  const double h = grid.min_spacing_mm();
  const auto structure_index_at = [&](int column, int row, double depth) -> std::uint8_t {
    const Point<Patient> pixel = camera.at(column, row);
    const Vector<Patient> direction = camera.is_parallel() ? camera.into() : (pixel - eye).normalized();
    for (const double behind : {0.4, 1.0, 0.0, 1.8, 3.0}) {
      const Point<Patient> at = (camera.is_parallel() ? pixel : eye) + direction * (depth + behind * h);
      // at a silhouette the rendered structure lies beside the ray: use the nearest of the eight voxels
      // around
      const Eigen::Vector3d voxel = (X_VoxelPatient * at).eigen();
      const Eigen::Vector3d low = voxel.array().floor();
      double nearest = 3;
      std::uint8_t index = 0;
      for (int corner = 0; corner < 8; ++corner) {
        const Eigen::Vector3d n = low + Eigen::Vector3d(corner & 1, corner >> 1 & 1, corner >> 2);
        const double separation = (n - voxel).squaredNorm();
        if (separation >= nearest || (n.array() < 0).any() || n[0] >= grid.dims[0] || n[1] >= grid.dims[1] ||
            n[2] >= grid.dims[2])
          continue;
        const LabelId label =
            labels_->at(static_cast<int>(n[0]), static_cast<int>(n[1]), static_cast<int>(n[2]));
        if (label >= prepared_.size() || prepared_[label].opacity == 0) continue;
        nearest = separation;
        index = label < structure_indices.size() ? structure_indices[label] : 0;
      }
      if (index != 0) return index;
    }
    return 0;
  };

  auto payload = std::make_shared<std::string>(kHead_bytes + 6 * pixels, '\0');
  std::copy_n("PLPV", 4, payload->begin());
  WireWriter head(payload->data() + 4);
  head.unsigned_integer(static_cast<std::uint16_t>(kProtocolVersion));
  head.unsigned_integer(std::uint16_t{0});
  head.unsigned_integer(static_cast<std::uint16_t>(camera.width_px));
  head.unsigned_integer(static_cast<std::uint16_t>(camera.height_px));
  head.real32(min_depth);
  head.real32(max_depth - min_depth);
  head.unsigned_integer(std::uint32_t{0});
  std::copy(rgb_.begin(), rgb_.end(), payload->begin() + kHead_bytes);
  WireWriter depths(payload->data() + kHead_bytes + 3 * pixels);
  char* structures = payload->data() + kHead_bytes + 5 * pixels;
  std::size_t n = 0;
  for (int row = 0; row < camera.height_px; ++row)
    for (int column = 0; column < camera.width_px; ++column, ++n) {
      const double depth = depth_mm_[n];
      const bool is_met = std::isfinite(depth);
      const double fraction =
          is_met && max_depth > min_depth ? (depth - min_depth) / (max_depth - min_depth) : 0;
      depths.unsigned_integer(static_cast<std::uint16_t>(std::lround(kDepthSteps * fraction)));
      structures[n] = is_met ? static_cast<char>(structure_index_at(column, row, depth)) : '\0';
    }
  return payload;
}

}  // namespace palpate::server
