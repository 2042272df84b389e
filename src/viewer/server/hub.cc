#include "server/hub.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "server/connection.h"
#include "server/viewer.h"

namespace palpate::server {
namespace {

constexpr auto kHousekeepingPeriod = std::chrono::milliseconds(100);
constexpr auto kShutdownTimeout = std::chrono::milliseconds(200);
// for viewers that still receive answers and results, over a slow network, too
constexpr auto kDeliveryTimeout = std::chrono::seconds(1);

// roles with a reserved slot, however many viewers there are
bool has_reserved_slot(Role role) {
  return role == Role::kControl || role == Role::kTeacher;
}

}  // namespace

Hub::Hub(EventLoop& loop, ViewerHost& host, Site& site, PayloadStore& volumes, PictureStore* pictures,
         DownloadRateLimiter downloads, FaultLog log, std::function<void(int)> on_viewer_count)
    : host_(host),
      live_(host.live()),
      site_(site),
      volumes_(volumes),
      pictures_(pictures),
      downloads_(downloads),
      log_(std::move(log)),
      on_viewer_count_(std::move(on_viewer_count)),
      loop_(loop),
      pose_timer_(loop.timer()),
      housekeeping_timer_(loop.timer()) {
  if (site.redaction() != nullptr) redacted_steps_.emplace(site.redaction()->scene());
}

Hub::~Hub() = default;

void Hub::begin() {
  schedule_housekeeping();
}

void Hub::end() {
  ended_ = true;
  pose_timer_->cancel();
  stop_when_delivered(Clock::now() + kDeliveryTimeout);
  for (const auto& connection : std::vector(connections_.begin(), connections_.end())) connection->close();
  // the state in which the session ended, and the results of a run that ended with it
  publish_state();
  publish_training(Clock::now());
  for (const auto& viewer : std::vector(viewers_.begin(), viewers_.end())) viewer->finish(kGoingAway);
  if (viewers_.empty()) loop_.stop();
}

// drops viewers that have not closed soon after their last message, or not received it by `latest`
void Hub::stop_when_delivered(Clock::time_point latest) {
  housekeeping_timer_->wait_until(Clock::now() + kShutdownTimeout, [this, latest] {
    const bool all_sent =
        std::ranges::all_of(viewers_, [](const auto& viewer) { return viewer->is_ending(); });
    if (all_sent || Clock::now() >= latest) return loop_.stop();
    stop_when_delivered(latest);
  });
}

// ---- connections

void Hub::add(std::shared_ptr<Connection> connection) {
  connections_.insert(std::move(connection));
}

void Hub::remove(const std::shared_ptr<Connection>& connection) {
  connections_.erase(connection);
}

void Hub::add(std::shared_ptr<Viewer> viewer) {
  viewers_.insert(std::move(viewer));
}

void Hub::remove(const std::shared_ptr<Viewer>& viewer) {
  if (viewers_.erase(viewer) == 0) return;
  if (viewer->welcomed() && live_ != nullptr) live_->forget(viewer->identity());
  if (pointer_owner_ == viewer.get()) {
    pointer_owner_ = nullptr;
    (void)live_->claim_pointer(false, viewer->identity());
  }
  if (viewer->welcomed()) update_viewer_count();
  if (ended_ && viewers_.empty()) loop_.stop();
}

bool Hub::has_single_downloader() const {
  return welcomed_ <= 1 && std::count_if(connections_.begin(), connections_.end(),
                                         [](const auto& connection) { return connection->is_loading(); }) <=
                               kDownloadsPerViewer;
}

DownloadRateLimiter::Chunk Hub::next_chunk(std::size_t left_bytes) {
  return downloads_.next(left_bytes, has_single_downloader(), Clock::now());
}

void Hub::make_room_for_connection() {
  if (connections_.empty() || connections_.size() + viewers_.size() < kMaxConnections) return;
  const auto rank = [](const auto& connection) {
    return std::pair(connection->phase(), connection->last_progress());
  };
  const auto oldest =
      std::min_element(connections_.begin(), connections_.end(),
                       [&](const auto& one, const auto& other) { return rank(one) < rank(other); });
  log_.add((*oldest)->peer(), "too many connections: this one, with the least progress, is closed");
  std::shared_ptr(*oldest)->close();
}

void Hub::drop_oldest_unauthenticated() {
  // a viewer that is closing occupies a slot while it waits for the close frame
  const auto ending =
      std::find_if(viewers_.begin(), viewers_.end(), [](const auto& viewer) { return viewer->is_ending(); });
  if (viewers_.size() >= kMaxViewers + kMaxUnauthenticated && ending != viewers_.end())
    std::shared_ptr(*ending)->remove_from_hub();
  std::shared_ptr<Viewer> oldest;
  std::size_t unauthenticated = 0;
  for (const auto& viewer : viewers_) {
    if (!viewer->is_silent()) continue;
    ++unauthenticated;
    if (!oldest || viewer->hello_by() < oldest->hello_by()) oldest = viewer;
  }
  if (unauthenticated >= kMaxUnauthenticated)
    oldest->end(kTryAgainLater, "too many viewers: a silent one is closed");
}

bool Hub::make_room_for_viewer(Role role) {
  std::shared_ptr<Viewer> latest;  // most recent one without control
  std::size_t all = 0, without_reserved_slot = 0;
  for (const auto& viewer : viewers_) {
    if (!viewer->welcomed() || viewer->is_ending()) continue;
    ++all;
    if (has_reserved_slot(viewer->who().role)) continue;
    ++without_reserved_slot;
    // the viewer that moves the tip is not dropped
    if (viewer.get() == pointer_owner_) continue;
    if (!latest || viewer->identity().number > latest->identity().number) latest = viewer;
  }
  if (!has_reserved_slot(role) && without_reserved_slot >= kMaxViewers - kReservedSlots) return false;
  if (all < kMaxViewers) return true;
  if (!has_reserved_slot(role) || !latest) return false;
  latest->end(kTryAgainLater, "gives its slot to a viewer with control or a teacher");
  return true;
}

void Hub::request_volume(const PayloadKey& key, std::function<void(PayloadStore::Payload)> then) {
  volumes_.request(key, [this, then = std::move(then)](PayloadStore::Payload payload) {
    loop_.post([then, payload = std::move(payload)] { then(payload); });
  });
}

void Hub::request_picture(PictureKey key, std::weak_ptr<const void> requester,
                          std::function<void(PictureStore::Payload)> then) {
  if (pictures_ == nullptr) return loop_.post([then = std::move(then)] { then(nullptr); });
  pictures_->request(std::move(key), std::move(requester),
                     [this, then = std::move(then)](PictureStore::Payload payload) mutable {
                       loop_.post([then = std::move(then), payload = std::move(payload)] { then(payload); });
                     });
}

void Hub::request_curves(const std::string& learner, std::function<void(Result<std::string>)> then) {
  volumes_.run([this, learner, then = std::move(then)] {
    Result<std::string> page = live_->curves(learner);
    loop_.post([then, page = std::move(page)] { then(page); });
  });
}

// ---- periodic work

void Hub::schedule_housekeeping() {
  housekeeping_timer_->wait_until(Clock::now() + kHousekeepingPeriod, [this] {
    if (ended_) return;
    schedule_housekeeping();
    run_housekeeping();
  });
}

void Hub::run_housekeeping() {
  const Clock::time_point now = Clock::now();
  for (const auto& connection : std::vector(connections_.begin(), connections_.end())) connection->check(now);
  for (const auto& viewer : std::vector(viewers_.begin(), viewers_.end())) viewer->check(now);
  log_.catch_up(now);
  site_.access().forget_inactive_guesses(now);
  if (welcomed_ == 0) return;
  health_ = host_.health();
  deliver_late_answers();
  publish_state();
}

void Hub::deliver_late_answers() {
  if (live_ == nullptr) return;
  for (const LateAnswer& late : live_->read_answers())
    for (const auto& viewer : viewers_)
      if (viewer->identity().number == late.by.number && viewer->welcomed())
        viewer->send(late.outcome ? done_json(late.id) : refused_json(late.id, late.outcome.error()));
}

}  // namespace palpate::server
