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

#include "link/veil.h"
#include "palpate/link/viewer_server.h"
#include "palpate/rendering/volume_renderer.h"

namespace palpate::link {

/// A picture of the volume as a viewer asks for it: rays through the middles of its pixels.
struct PictureKey {
  VolumeCamera camera;
  std::vector<Rgb> colours;       ///< of the scene's first structures; of the others the scene's own
  std::vector<double> opacities;  ///< likewise, 0 ... 1
  std::optional<ClipPlane> clip;  ///< what lies on that side of it is taken away
  bool gzip = false;
  const Veil* veil = nullptr;  ///< through which it is seen, the same one always; outlives the store
};
/// From a query as docs/reference/viewer-http.md has it, `view=...&looks=...&cut=...`; nothing where it
/// is none.
std::optional<PictureKey> parse_picture_query(std::string_view query, std::size_t structures);

/// Pictures of a session's volume, made one after another by a thread of the lowest priority, whose helpers
/// leave one processor alone: the servo, poses and volumes come first. The labels are prepared when somebody
/// asks first, and again for other looks; when nobody has asked for a while, what was prepared is given back.
class PictureStore {
 public:
  using Payload = std::shared_ptr<const std::string>;
  /// Of larger volumes there are none: a solid voxel takes 32 bytes while one is looked at.
  static constexpr std::size_t kMostVoxels = std::size_t{1} << 28;
  /// So many wishes wait; of more the oldest is not granted.
  static constexpr std::size_t kMostWaiting = 16;

  /// @param host  is asked for its labels before each picture: what a burr took meanwhile is gone, and tissue
  ///              is where it has yielded to. Outlives
  ///              the store
  explicit PictureStore(const ViewerHost& host);
  /// Ends after the picture that is being made; nobody is told of any.
  ~PictureStore();
  PictureStore(const PictureStore&) = delete;
  PictureStore& operator=(const PictureStore&) = delete;

  /// Hands over the bytes on the store's own thread, or nothing where there is none.
  /// @param asker  whoever is gone when it is the wish's turn gets none
  void want(PictureKey key, std::weak_ptr<const void> asker, std::function<void(Payload)> then);

 private:
  struct Wish {
    PictureKey key;
    std::weak_ptr<const void> asker;
    std::function<void(Payload)> then;
  };
  /// How a scene's structures look, by label, and their places in it.
  struct Looks {
    explicit Looks(const ViewedScene& scene);
    std::vector<StructureLook> of_label;
    std::vector<LabelId> label_of;       ///< of the scene's structures
    std::vector<std::uint8_t> place_of;  ///< of a label among these, + 1; 0: in none
  };
  /// What is drawn for those who see the session through a veil.
  struct Veiled {
    explicit Veiled(const Veil& veil, const ViewedScene& whole)
        : looks(veil.scene()), cuts(whole.labels, veil.scene().labels) {}
    Looks looks;
    VeiledCuts cuts;
  };
  void work();
  Payload made(const PictureKey& key);
  Payload drawn(const PictureKey& key);
  bool prepare(const PictureKey& key);

  const ViewerHost& host_;
  const Looks looks_;
  // of the store's thread alone
  std::optional<Veiled> veiled_;
  const Veil* prepared_for_ = nullptr;
  std::shared_ptr<const Bricks<LabelId>> labels_;
  std::optional<VolumeRenderer> renderer_;  ///< of these labels
  std::vector<StructureLook> prepared_;     ///< with these looks
  std::vector<std::uint8_t> rgb_;
  std::vector<float> depth_mm_;

  std::mutex mutex_;
  std::condition_variable wished_;
  std::deque<Wish> wishes_;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

}  // namespace palpate::link
