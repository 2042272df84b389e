#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "palpate/rendering/volume_renderer.h"
#include "palpate/server/viewer_host.h"
#include "server/redaction.h"

namespace palpate::server {

/// Request for a picture of the volume: rays through the pixel centres.
struct PictureKey {
  VolumeCamera camera;
  std::vector<Rgb> colours;       ///< Colours of the scene's first structures; the others keep the scene's
  std::vector<double> opacities;  ///< Opacities of the same structures, 0 ... 1
  std::optional<ClipPlane> clip;  ///< Half-space that is cut away
  bool gzip = false;
  /// Redaction to be applied, always the same object; outlives the store; null: none
  const Redaction* redaction = nullptr;
};
/// Parses a query as specified in docs/reference/viewer-http.md, `view=...&looks=...&cut=...`; empty if
/// malformed.
std::optional<PictureKey> parse_picture_query(std::string_view query, std::size_t structures);

/// Renders pictures of a session's volume sequentially on a thread of the lowest priority, whose helpers
/// leave one CPU free: servo, poses and volumes have priority. The labels are prepared on the first request,
/// and again for other colours or opacities; prepared data are freed after a period without requests.
class PictureStore {
 public:
  using Payload = std::shared_ptr<const std::string>;
  /// Larger volumes are not rendered: a solid voxel takes 32 bytes while prepared.
  static constexpr std::size_t kMaxVoxels = std::size_t{1} << 28;
  /// Maximum number of queued requests; beyond it the oldest is dropped.
  static constexpr std::size_t kMaxWaiting = 16;

  /// @param host  supplies the labels before each picture, including removal and deformation. Outlives the
  /// store
  explicit PictureStore(const ViewerHost& host);
  /// Ends after the current picture; no callbacks are called.
  ~PictureStore();
  PictureStore(const PictureStore&) = delete;
  PictureStore& operator=(const PictureStore&) = delete;

  /// Passes the bytes to `then` on the store's thread, or null if there is no picture.
  /// @param requester  the request is dropped if this has expired
  void request(PictureKey key, std::weak_ptr<const void> requester, std::function<void(Payload)> then);

 private:
  struct QueuedRequest {
    PictureKey key;
    std::weak_ptr<const void> requester;
    std::function<void(Payload)> then;
  };
  /// Colours and opacities by label, and the index of each structure in the scene.
  struct Appearances {
    explicit Appearances(const ViewedScene& scene);
    std::vector<StructureAppearance> of_label;
    std::vector<LabelId> label_of;       ///< Label of each of the scene's structures
    std::vector<std::uint8_t> index_of;  ///< Index of a label in the scene's structures, plus 1; 0: none
  };
  /// State for viewers to whom a redaction applies.
  struct Redacted {
    explicit Redacted(const Redaction& redaction, const ViewedScene& whole)
        : appearances(redaction.scene()), cuts(whole.labels, redaction.scene().labels) {}
    Appearances appearances;
    RedactedCuts cuts;
  };
  void work();
  /// Picture in wire format; null if there is none or if rendering threw.
  Payload try_render(const PictureKey& key);
  Payload render(const PictureKey& key);
  bool prepare(const PictureKey& key);

  const ViewerHost& host_;
  const Appearances appearances_;
  // used by the store's thread only
  std::optional<Redacted> redacted_;
  const Redaction* prepared_for_ = nullptr;
  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::optional<VolumeRenderer> renderer_;     ///< Prepared for labels_
  std::vector<StructureAppearance> prepared_;  ///< Colours and opacities that it is prepared for
  std::vector<std::uint8_t> rgb_;
  std::vector<float> depth_mm_;

  std::mutex mutex_;
  std::condition_variable work_available_;
  std::deque<QueuedRequest> queue_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace palpate::server
