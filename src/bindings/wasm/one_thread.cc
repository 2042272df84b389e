#include <exception>

#include "palpate/base/check.h"
#include "palpate/navigation/navigated_tip.h"
#include "palpate/servo/realtime.h"
#include "palpate/session/shared_plan.h"
#include "server/access.h"
#include "server/page.h"
#include "server/payload_store.h"
#include "server/volume_pictures.h"
#include "session/deformed_labels.h"
#include "session/preparation_thread.h"
#include "session/tissue_thread.h"
#include "session/training.h"

// Single-threaded implementations, for a browser's worker, of those parts of a session that natively use
// threads, files or the network.
namespace palpate {

const std::vector<EmbeddedFile>& viewer_page() {
  static const std::vector<EmbeddedFile> none;
  return none;
}

namespace server {

// ---- volumes are generated synchronously

PayloadStore::PayloadStore(Generator make) : make_(std::move(make)) {}
PayloadStore::~PayloadStore() = default;
void PayloadStore::run(std::function<void()> job) {
  job();
}

// the page asks for none of these: it reads volumes as they are, without tokens, and draws pictures itself
std::shared_ptr<const std::string> gzip(const std::string& /*bytes*/, const std::atomic<bool>& /*stop*/,
                                        int /*level*/) {
  return nullptr;
}
std::optional<AuthenticatedViewer> Tokens::holder_of(std::string_view /*token*/) const {
  return {};
}
std::vector<std::string> Tokens::learners() const {
  return {};
}
bool Tokens::has(Role /*role*/) const {
  return false;
}
std::optional<PictureKey> parse_picture_query(std::string_view /*query*/, std::size_t /*structures*/) {
  return {};
}
void PictureStore::request(PictureKey /*key*/, std::weak_ptr<const void> /*asker*/,
                           std::function<void(Payload)> then) {
  then(nullptr);
}

}  // namespace server

// ---- nothing is prepared in the background

Result<void> PreparationThread::wake(const LiveModel::Lock& /*held*/) {
  return Error{ErrorKind::kUnavailable,
               "this would be prepared in the background, which a browser cannot yet", "",
               "start palpate on a computer for it"};
}
void PreparationThread::end() {}

// ---- solver threads, tasks and plans: the sessions of WorkerSession have none, so that these functions are
// not called

TissueThread::TissueThread(const ServoLoop& loop, TissueFrames& frames) : loop_(loop), frames_(frames) {
  PALPATE_CHECK(false);
}
TissueThread::~TissueThread() = default;
std::shared_ptr<const Bricks<LabelId>> DeformedLabels::of(const ViewerHost& host) {
  return host.labels();
}

void Training::set_tip_holder(const std::optional<ViewerIdentity>& /*holder*/) {}
Result<void> Training::begin(const std::string& /*task*/, const std::string& /*learner*/) {
  return {};
}
Result<void> Training::end_run() {
  return {};
}
Result<void> Training::begin_or_end() {
  return {};
}
Result<void> Training::teach(const LessonRequest& /*request*/) {
  return {};
}
ViewedState::Lesson Training::lesson() const {
  return {};
}
ViewedTraining Training::state() const {
  return {};
}
std::shared_ptr<const ViewedDebriefing> Training::debriefing() const {
  return nullptr;
}
std::shared_ptr<const ViewedPlan> SharedPlan::viewed() const {
  return nullptr;
}
Result<void> SharedPlan::change(const PlanRequest& /*request*/) {
  return {};
}

// ---- no tool is tracked, and no thread has a scheduler

std::optional<TipError> error_of_tip(const Navigation& /*navigation*/, const Point<Patient>& /*tip*/) {
  return {};
}
std::string scheduler_of_thread(pid_t /*tid*/) {
  return {};
}

}  // namespace palpate
