#include "server/rpc/health.h"

#include "candela/v1/render.grpc.pb.h"
#include "server/base/log.h"

namespace candela {

void Health::begin(grpc::HealthCheckServiceInterface& service) {
  absl::MutexLock lock(&mutex_);
  service_ = &service;
  tell();
}

void Health::pulse(bool working, bool moving) {
  absl::MutexLock lock(&mutex_);
  if (working != working_) {
    log_event(working ? LogLevel::kInfo : LogLevel::kError,
              working ? "frames come out again" : "no frame comes out; health says NOT_SERVING",
              {{"render_thread", moving ? "moves" : "is stuck"}});
  }
  working_ = working;
  moving_ = moving;
  tell();
}

void Health::door(bool answers, bool alive) {
  absl::MutexLock lock(&mutex_);
  if (answers != door_answers_) {
    log_event(answers ? LogLevel::kInfo : LogLevel::kError,
              answers ? "connections are answered again"
                      : "connections to its own address are not answered; health says NOT_SERVING");
  }
  door_answers_ = answers;
  door_alive_ = alive;
  tell();
}

void Health::drain() {
  absl::MutexLock lock(&mutex_);
  draining_ = true;
  tell();
}

bool Health::working() const {
  absl::MutexLock lock(&mutex_);
  return working_;
}

bool Health::alive() const {
  absl::MutexLock lock(&mutex_);
  return live();
}

void Health::tell() {
  if (service_ == nullptr) return;
  const bool ready = working_ && door_answers_ && live() && !draining_;
  for (const char* name : {"", v1::RenderService::service_full_name(), "readiness"}) {
    service_->SetServingStatus(name, ready);
  }
  service_->SetServingStatus("liveness", live());
  metrics_.health(ready, live());
}

}  // namespace candela
