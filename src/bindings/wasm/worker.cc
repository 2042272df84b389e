// The functions that the worker's JavaScript calls (web/src/worker/palpate_worker.ts): a session on a scene,
// and the page as its only viewer, by the viewer's protocol.

#include <array>
#include <chrono>
#include <cstdint>
#include <list>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "loading/read_scene.h"
#include "palpate/base/check.h"
#include "palpate/base/reading.h"
#include "palpate/base/spsc_ring.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/pointer_driver.h"
#include "palpate/volume_io/volume_io.h"
#include "server/hub.h"
#include "server/site.h"
#include "server/viewer.h"
#include "session/live_session.h"
#include "session/measured_cells.h"
#include "session/session_statistics.h"
#include "wasm/page_files.h"
#include "wasm/worker_loop.h"

#define PALPATE_EXPORT extern "C" __attribute__((visibility("default")))

// functions of the worker's JavaScript
extern "C" {
/// @param share  part of the stage that is done, 0 ... 1
__attribute__((import_module("palpate"), import_name("progress"))) void palpate_progress(const char* stage,
                                                                                         std::size_t length,
                                                                                         double share);
}

namespace palpate::wasm {
namespace {

constexpr double kRate_hz = 1000, kMax_force_N = 3;
constexpr int kPort = 80;
// processor time that a frame of the tissue solver may take: the rest of the time between two frames is left
// to ticks and messages
constexpr double kMaxTissueFrame_s = 0.5 * kSolverFrame_s;
// Host field of the page's requests
constexpr std::string_view kHost = "localhost:80";

/// Session with its loop and its viewer, in the order in which they are built.
class WorkerSession {
 public:
  /// @param progress  reports while files are read and the scene is prepared
  static Result<std::unique_ptr<WorkerSession>> open(const SceneSource& source, const Progress& progress);
  WorkerSession(const LoadedScene& loaded, MeasuredCells measured);

  Result<void> begin();
  void connect();
  void receive(std::string text) {
    if (socket_) socket_->receive(std::move(text));
  }
  void disconnect();
  /// @param body  receives the answer's body
  int get(std::string_view target, std::shared_ptr<const std::string>& body);
  /// @returns whether there is more to do at once
  bool step();

 private:
  LiveSessionParts parts(const LoadedScene& loaded, std::string coarser_tissue);

  std::shared_ptr<const Model> model_;
  WorkspaceSettings workspace_;
  Parameters parameters_;
  GridClock clock_{kRate_hz};
  PointerDriver pointer_;
  LiveSession live_;
  SessionStatistics statistics_;
  std::unique_ptr<ServoLoop> servo_;

  WorkerLoop loop_;
  server::ScanScale scale_;
  std::optional<server::PayloadStore> volumes_;
  std::optional<server::Site> site_;
  std::optional<server::Hub> hub_;
  std::shared_ptr<WorkerSocket> socket_;
};

Parameters first_parameters() {
  Parameters parameters;
  parameters.method = ForceMethod::kProxy;
  parameters.max_force_N = kMax_force_N;
  return parameters;
}

Point<Device> above(const WorkspaceSettings& workspace) {
  return WorkspaceMapping(PointerDriver::info(), workspace).to_device(Point<World>(0, 0, 0));
}

MeasuredCells cells_for_browser(std::shared_ptr<const Model> model) {
  // the browser optimises code while it runs, so that the first measurement is too slow: a limit that no
  // frame meets solves in cells of all sizes
  with_measured_cells(model, 1, 0);
  return with_measured_cells(std::move(model), 1, kMaxTissueFrame_s);
}

Result<std::unique_ptr<WorkerSession>> WorkerSession::open(const SceneSource& source,
                                                           const Progress& progress) {
  auto loaded = load_scene_or_data_set(source, progress);
  if (!loaded) return loaded.error();
  if (auto touchable = has_touchable_tissue(*loaded->model); !touchable)
    return Error{ErrorKind::kBadInput, "has no tissue that can be touched", source.target,
                 "name its structures after tissues (femur, liver, ...) in the file or in a table"};
  constexpr ForceMethod kProxyAlone[] = {ForceMethod::kProxy};
  auto ready = prepared_with_cache(loaded->model, kProxyAlone, progress);
  if (!ready) return ready.error();
  auto session = std::make_unique<WorkerSession>(*loaded, cells_for_browser(*std::move(ready)));
  if (auto begun = session->begin(); !begun) return begun.error();
  return session;
}

WorkerSession::WorkerSession(const LoadedScene& loaded, MeasuredCells measured)
    : model_(std::move(measured.model)),
      workspace_(loaded.scene.workspace),
      parameters_(first_parameters()),
      pointer_(above(workspace_), GridClock::now),
      live_(parts(loaded, std::move(measured.warning))),
      statistics_(*model_, {}) {}

LiveSessionParts WorkerSession::parts(const LoadedScene& loaded, std::string coarser_tissue) {
  LiveSessionParts parts;
  parts.model = model_;
  parts.devices = {PointerDriver::info()};
  parts.workspace = workspace_;
  parts.parameters = parameters_;
  parts.input = kPointer;
  parts.rate_hz = kRate_hz;
  parts.pointer = &pointer_;
  parts.modality = loaded.scene.modality;
  parts.coarser_tissue = std::move(coarser_tissue);
  parts.threads = false;
  return parts;
}

Result<void> WorkerSession::begin() {
  LoopSettings settings;
  settings.rate_hz = kRate_hz;
  auto loop =
      ServoLoop::make_unthreaded(model_, pointer_, parameters_, {workspace_}, settings, GridClock::now);
  if (!loop) return loop.error();
  servo_ = *std::move(loop);
  live_.begin(*servo_, statistics_);

  const ViewedScene& scene = live_.scene();
  scale_ = scene.scan ? server::ScanScale::of(*scene.scan) : server::ScanScale{};
  const server::VolumeFacts facts = server::facts_of(scene, scale_);
  volumes_.emplace(server::volume_generator(scene.scan, scale_, scene.labels, facts.wide_labels));
  site_.emplace(live_, server::Access("localhost", kPort, false, {}, {}), facts);
  // the page is the only viewer: its downloads are not limited
  const server::DownloadRateLimiter downloads(0, server::DownloadRateLimiter::Clock::now());
  hub_.emplace(loop_, live_, *site_, *volumes_, nullptr, downloads, server::FaultLog({}), [](int) {});
  hub_->begin();
  return {};
}

void WorkerSession::connect() {
  disconnect();
  socket_ = std::make_shared<WorkerSocket>(loop_);
  const auto viewer = std::make_shared<server::Viewer>(socket_, "page", server::AddressBlock{}, *hub_);
  hub_->add(viewer);
  viewer->begin();
}

void WorkerSession::disconnect() {
  if (socket_) socket_->closed_by_page();
}

int WorkerSession::get(std::string_view target, std::shared_ptr<const std::string>& body) {
  server::HttpRequest request;
  request.method = "GET";
  request.target = target;
  request.host = kHost;
  request.local_address = "localhost";
  request.at = std::chrono::steady_clock::now();
  auto answer = site_->answer(request);
  if (auto* volume = std::get_if<server::VolumeRequest>(&answer)) {
    // made in this call: there is no other thread
    volumes_->request(volume->key,
                      [&body](server::PayloadStore::Payload payload) { body = std::move(payload); });
    return body ? 200 : 503;
  }
  constexpr int kNotFound = 404;
  auto* ready = std::get_if<server::HttpResponse>(&answer);
  if (ready == nullptr) return kNotFound;
  body = ready->body ? ready->body : std::make_shared<const std::string>(ready->fixed_body);
  return ready->status;
}

bool WorkerSession::step() {
  clock_.wake();
  servo_->run(clock_);
  std::array<TickRecord, 8> ticks;
  for (std::size_t count = servo_->ring().pop(ticks); count > 0; count = servo_->ring().pop(ticks))
    for (const TickRecord& tick : std::span(ticks).first(count)) {
      statistics_.observe(tick);
      live_.observe(tick);
    }
  loop_.run_due();
  const bool is_more_due = live_.run_step(std::chrono::steady_clock::now());
  // nothing records the session: its log would only grow
  std::list<RecordingEvent> unrecorded;
  live_.log().take(unrecorded);
  return is_more_due;
}

std::unique_ptr<WorkerSession> session;
std::string problem;
std::shared_ptr<const std::string> answered;

bool open_session(const Result<SceneSource>& source) {
  session.reset();
  const Progress progress(
      [](std::string_view stage, double share) { palpate_progress(stage.data(), stage.size(), share); },
      nullptr);
  auto opened = source ? WorkerSession::open(*source, progress) : source.error();
  problem = opened ? std::string() : opened.error().message();
  if (opened) session = *std::move(opened);
  return session != nullptr;
}

}  // namespace
}  // namespace palpate::wasm

using palpate::wasm::session;

/// Opens a session on a phantom, in place of an earlier one. Returns false if it cannot be opened;
/// palpate_problem() says why.
PALPATE_EXPORT bool palpate_open(const char* scene, std::size_t length) {
  return palpate::wasm::open_session(palpate::SceneSource{std::string(scene, length)});
}

/// Opens a session on files of the current folder, otherwise as palpate_open().
/// @param names    their names, one a line
/// @param read_as  interpretation of a single volume; 0: by its values, 1: label map, 2: scan
PALPATE_EXPORT bool palpate_open_files(const char* names, std::size_t length, int read_as) {
  palpate::set_read_as(read_as == 1   ? palpate::ReadAs::kLabels
                       : read_as == 2 ? palpate::ReadAs::kScan
                                      : palpate::ReadAs::kByContent);
  return palpate::wasm::open_session(palpate::wasm::source_of_files({names, length}));
}

/// Limits the memory that the page may take; bytes.
PALPATE_EXPORT void palpate_limit_memory(double bytes) {
  palpate::set_reading_limits({.max_memory_bytes = static_cast<std::uint64_t>(bytes), .follow_links = false});
}

PALPATE_EXPORT const char* palpate_problem() {
  return palpate::wasm::problem.c_str();
}

/// Answers a request for a path of the viewer's HTTP interface. Returns the status; palpate_body() and
/// palpate_body_size() have the answer until the next request.
PALPATE_EXPORT int palpate_get(const char* target, std::size_t length) {
  palpate::wasm::answered.reset();
  return session->get({target, length}, palpate::wasm::answered);
}

PALPATE_EXPORT const char* palpate_body() {
  return palpate::wasm::answered ? palpate::wasm::answered->data() : nullptr;
}

PALPATE_EXPORT std::size_t palpate_body_size() {
  return palpate::wasm::answered ? palpate::wasm::answered->size() : 0;
}

/// Connects the page's socket, in place of an earlier one.
PALPATE_EXPORT void palpate_connect() {
  session->connect();
}

PALPATE_EXPORT void palpate_disconnect() {
  session->disconnect();
}

PALPATE_EXPORT void palpate_receive(const char* text, std::size_t length) {
  session->receive({text, length});
}

/// Runs the ticks, timers and jobs that are due, and one step of solving and removing tissue. Returns whether
/// another such step is due: then the caller calls again as soon as it has handled its messages.
PALPATE_EXPORT bool palpate_step() {
  return session->step();
}
