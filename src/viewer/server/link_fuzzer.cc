#include <cmath>
#include <cstdint>
#include <string_view>

#include "server/access.h"
#include "server/request.h"
#include "server/site.h"
#include "server/test_host.h"

// The first byte selects the kind of input: a viewer's message, a token file, or the fields of a request, one
// per line. Every input has to yield an answer or a refusal.
namespace palpate::server {
namespace {

void message(std::string_view text) {
  const auto parsed = parse_viewer_message(text);
  if (!parsed) return;
  if (const auto* tip = std::get_if<TipMessage>(&*parsed); tip && tip->target) {
    for (const double mm : tip->target->tip_patient_mm) PALPATE_CHECK(std::isfinite(mm));
    for (const double component : tip->target->into) PALPATE_CHECK(std::isfinite(component));
    PALPATE_CHECK(std::isfinite(tip->target->force_N));
  }
  if (const auto* hello = std::get_if<Hello>(&*parsed))
    PALPATE_CHECK(hello->poses_hz >= 1 && hello->poses_hz <= 120);
  const auto* request = std::get_if<Request>(&*parsed);
  if (!request) return;
  if (const auto* set = std::get_if<SettingsRequest>(&request->body)) {
    PALPATE_CHECK(!set->max_force_N || std::isfinite(*set->max_force_N));
    double square = 1;
    if (set->rotation_wxyz) {
      square = 0;
      for (const double component : *set->rotation_wxyz) square += component * component;
    }
    PALPATE_CHECK(std::abs(square - 1) < 1e-9);
  }
  if (const auto* tissue = std::get_if<TissueRequest>(&request->body)) PALPATE_CHECK(tissue->tissue >= 0);
  if (const auto* task = std::get_if<TaskRequest>(&request->body))
    PALPATE_CHECK(task->begin.has_value() != task->end && (!task->begin || task->begin->size() <= 256));
  if (const auto* lesson = std::get_if<LessonRequest>(&request->body))
    PALPATE_CHECK(lesson->learner || lesson->task || lesson->names || lesson->pointer || lesson->end);
  if (const auto* plan = std::get_if<PlanRequest>(&request->body))
    PALPATE_CHECK(plan->trajectory.has_value() != (plan->save || plan->restore_version.has_value()));
  if (const auto* error = std::get_if<Error>(&request->body))
    PALPATE_CHECK(!refused_json(request->id, *error).empty());
}

void http(std::string_view text) {
  static testing::FakeHost host;
  static Site site(host, Access("127.0.0.1", 8480, false, {"theatre.example"}, {}),
                   {"00aa", 1, 0, {0, 1}, false});
  const auto line = [&] {
    const std::string_view row = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(text.size(), row.size() + 1));
    return row;
  };
  HttpRequest request;
  for (std::string_view* part :
       {&request.method, &request.target, &request.host, &request.origin, &request.fetch_site,
        &request.authorization, &request.accept_encoding, &request.if_none_match})
    *part = line();
  const auto answer = site.answer(request);
  const auto* ready = std::get_if<HttpResponse>(&answer);
  if (!ready) return;
  // no line end of the input may appear in the head
  const std::string head = site.head_of(*ready, request, true);
  PALPATE_CHECK(head.find("\r\n\r\n") == head.size() - 4);
}

}  // namespace
}  // namespace palpate::server

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::string_view text(reinterpret_cast<const char*>(data) + 1, size - 1);
  switch (data[0] % 3) {
    case 0:
      palpate::server::message(text);
      break;
    case 1:
      (void)palpate::server::Tokens::parse(text, "tokens");
      break;
    default:
      palpate::server::http(text);
  }
  return 0;
}
