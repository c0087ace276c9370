#include "server/server.h"

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <utility>

#include "absl/hash/hash.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "candela/v1/render.pb.h"
#include "proto/candela/v1/settings.h"
#include "server/access/access.h"
#include "server/base/address.h"
#include "server/base/clock.h"
#include "server/base/log.h"
#include "server/base/metrics.h"
#include "server/base/process.h"
#include "server/base/status_macros.h"
#include "server/base/words.h"
#include "server/config.h"
#include "server/device_keeper.h"
#include "server/grpc_listener.h"
#include "server/memory_budget.h"
#include "server/render/renderer.h"
#include "server/render/self_test.h"
#include "server/render/settings/error_bound.h"
#include "server/render/settings/tiers.h"
#include "server/rpc/health.h"
#include "server/rpc/render_service.h"
#include "server/rpc/service_state.h"
#include "server/schedule/heartbeat.h"
#include "server/schedule/render_loop.h"
#include "server/session/sessions.h"
#include "server/vulkan/device.h"

#ifndef CANDELA_VERSION
#error "the build sets CANDELA_VERSION"
#endif

namespace candela {
namespace {

// The frames that the server accepts: limited by `config` and by the device.
FrameLimits frame_limits(const Config& config, const DeviceSummary& device) {
  return {config.max_dimension, std::min(config.max_frame_bytes, device.max_allocation_bytes)};
}

// The answer to GetServerInfo, without the parts that change while the server runs.
v1::GetServerInfoResponse server_info(const Config& config, const RenderDevice& opened) {
  const DeviceSummary& device = opened.device->summary();
  v1::GetServerInfoResponse info;
  info.set_version(CANDELA_VERSION);
  v1::DeviceInfo& about = *info.mutable_device();
  about.set_name(device.name);
  about.set_type(device.type);
  about.set_driver(device.driver);
  about.set_api_version(device.api_version);
  about.set_unified_memory(device.unified_memory);
  about.set_passes(executor_word(opened.renderer->executor_kind()));
  about.set_bits(opened.bits);
  for (int i = 1; v1::PixelFormat_IsValid(i); ++i) info.add_formats(static_cast<v1::PixelFormat>(i));
  for (int i = 1; v1::OutputFormat_IsValid(i); ++i) info.add_output_formats(static_cast<v1::OutputFormat>(i));
  for (int i = 1; v1::ToneCurve_IsValid(i); ++i) info.add_curves(static_cast<v1::ToneCurve>(i));
  for (int i = 1; v1::Transfer_IsValid(i); ++i) info.add_transfers(static_cast<v1::Transfer>(i));
  for (const Tier& tier : tiers()) {
    v1::Tier& row = *info.add_tiers();
    row.set_name(tier.name);
    row.set_summary(tier.summary);
    const Settings settings;
    BoundFacts facts = {.exposure = 1, .threshold = settings->bloom().threshold()};
    row.set_max_error_codes(error_bound(tier, settings, facts));
    facts.blooms = true;
    row.set_max_error_codes_with_bloom(error_bound(tier, settings, facts));
  }
  for (const v1::SettingField& setting : v1::setting_fields())
    *info.add_settings() = v1::setting_info(setting);
  const FrameLimits limits = frame_limits(config, device);
  info.mutable_limits()->set_max_frame_bytes(limits.max_frame_bytes);
  info.mutable_limits()->set_max_dimension(limits.max_dimension);
  info.mutable_limits()->set_max_band_bytes(v1::kMaxBandBytes);
  info.mutable_limits()->set_memory_budget_bytes(config.memory_budget_bytes);
  const bool bakes = opened.renderer->check_environments().ok();
  info.mutable_limits()->set_environment_budget_bytes(bakes ? config.environment_budget_bytes : 0);
  info.mutable_limits()->set_max_sessions(config.max_sessions);
  info.mutable_limits()->set_max_frames_in_flight(config.max_frames_in_flight);
  return info;
}

// Time for calls that are refused at the last moment to receive their status. Health watchers use all of it,
// and so do clients that wait for nothing: they may not read for seconds.
constexpr absl::Duration kRefusalGrace = absl::Milliseconds(500);

// The same if calls were in flight. A call leaves when its answer is written, and its client may need longer
// to read it, on a slow connection or a busy machine. Without its last part the answer would be torn.
constexpr absl::Duration kAnswerGrace = absl::Seconds(5);

// The test frame that the heartbeat renders.
constexpr FrameDesc kBeat = {8, 8, kUsualFormat};

// The render thread counts as stuck when one frame takes this many times heartbeat_limit.
constexpr int kMovingLimits = 4;

// `asked` with the limits that the control group's memory allows.
Config fit_to_memory(const Config& asked, const MemoryBudget& budget) {
  Config config = asked;
  config.memory_budget_bytes = budget.bytes;
  if (config.environment_budget_bytes == 0) config.environment_budget_bytes = budget.bytes / 4;
  config.max_sessions = std::min(config.max_sessions, budget.most_sessions);
  config.max_calls = std::min(config.max_calls, budget.most_sessions);
  return config;
}

void log_limits(const CgroupLimits& limits, const MemoryBudget& budget, const DescriptorBudget& descriptors,
                const Config& config) {
  log_event(LogLevel::kInfo, "limits",
            {{"cpus", uint64_t{usable_cpus(limits)}},
             {"cpus_from", limits.cpus ? absl::StrFormat("%g of %s", *limits.cpus, limits.cpus_from)
                                       : "the CPUs that this process may use"},
             {"memory_budget", format_bytes(budget.bytes)},
             {"memory_budget_from", budget.from},
             {"sessions", uint64_t{config.max_sessions}},
             {"calls", uint64_t{config.max_calls}},
             {"descriptors", descriptors.limit},
             {"connections", uint64_t{descriptors.connections}}});
  if (!budget.beyond_the_limit) return;
  log_event(LogLevel::kWarning,
            "memory-budget exceeds the memory limit; the process will be killed before it refuses a frame",
            {{"limit", format_bytes(*limits.memory_bytes)}, {"limit_from", limits.memory_from}});
}

}  // namespace

struct Server::Impl {
  Impl(const Config& c, Clock& time, std::unique_ptr<Access> a)
      : config(c), clock(time), access(std::move(a)) {}

  void keep_device(std::shared_ptr<RenderDevice> first, DeviceKeeper::Open open,
                   std::function<void()> on_gone);
  void make_service(TokenKeys keys, Timers& timers);
  void watch_health();
  absl::Status serve_metrics();
  void open_memory_door();
  absl::Status listen();
  // These two run on the render thread.
  absl::StatusOr<FrameReport> render(const FrameJob& job);
  absl::Status beat();
  absl::Status render_beat(FrameMaker& renderer, ClientMemory& memory);
  // Cancels calls that still run after `grace`.
  void stop(absl::Duration grace);

  const Config config;
  Clock& clock;
  std::unique_ptr<Access> access;
  std::unique_ptr<Metrics> metrics;
  std::unique_ptr<DeviceKeeper> devices;
  std::unique_ptr<RenderLoop> loop;
  std::unique_ptr<WorkerThreads> encoders;
  std::unique_ptr<ServiceState> state;
  std::unique_ptr<RenderService> service;
  std::unique_ptr<MemoryDoor> memory_door;  // null if no address is a unix socket
  DescriptorBudget descriptors;
  OpenConnections connections;
  GrpcListener listener;
  std::unique_ptr<Health> health;
  std::unique_ptr<Heartbeat> heartbeat;
  std::unique_ptr<OwnDoor> own_door;
  std::unique_ptr<MetricsServer> metrics_server;
  std::string metrics_address;
};

void Server::Impl::keep_device(std::shared_ptr<RenderDevice> first, DeviceKeeper::Open open,
                               std::function<void()> on_gone) {
  const DeviceSummary& device = first->device->summary();
  metrics = std::make_unique<Metrics>(CANDELA_VERSION, device.name, device.driver,
                                      first->renderer->executor_words());
  devices = std::make_unique<DeviceKeeper>(
      first, std::move(open), *metrics,
      DeviceKeeper::Events{.on_replaced = [this] { state->environments.forget_others(*devices->renderer()); },
                           .on_gone = std::move(on_gone)});
}

void Server::Impl::make_service(TokenKeys keys, Timers& timers) {
  const std::shared_ptr<RenderDevice> opened = devices->current();
  const DeviceSummary& device = opened->device->summary();
  loop = std::make_unique<RenderLoop>(
      [this](const FrameJob& job) { return render(job); },
      1 + config.max_calls + config.max_sessions * (config.max_frames_in_flight + v1::kLookahead.max), clock,
      config.slice);
  encoders = std::make_unique<WorkerThreads>(config.encoder_threads);
  state.reset(new ServiceState{
      .clock = clock,
      .timers = timers,
      .rendering = {.renderer = [d = devices.get()] { return d->renderer(); },
                    .loop = *loop,
                    .encoders = *encoders,
                    .device = device.name,
                    .bits = opened->bits},
      .limits = {frame_limits(config, device), config.idle_timeout, config.max_frames_in_flight,
                 !config.token_file.empty()},
      .metrics = *metrics,
      .call_gate = CallGate("calls", config.max_calls),
      .session_gate = CallGate("sessions", config.max_sessions),
      .sessions = {.keys = std::move(keys),
                   .memory = std::make_shared<ClientMemory>(config.memory_budget_bytes, config.client_share,
                                                            config.idle_timeout / 2)},
      .environments = EnvironmentStore(config.environment_budget_bytes)});
  service = std::make_unique<RenderService>(
      *state, [d = devices.get()] { return d->current()->pool.counters(); }, server_info(config, *opened));
}

void Server::Impl::watch_health() {
  health = std::make_unique<Health>(*metrics);
  heartbeat = std::make_unique<Heartbeat>(
      *loop, clock, [this] { return beat(); },
      Heartbeat::Options{.interval = config.heartbeat_interval,
                         .limit = config.heartbeat_limit,
                         .moving_limit = kMovingLimits * config.heartbeat_limit},
      [this](Heartbeat::Pulse pulse) { health->pulse(pulse.working, pulse.moving); });
}

absl::Status Server::Impl::serve_metrics() {
  if (config.metrics.empty()) return absl::OkStatus();
  metrics->set_sampler([this]() -> Metrics::Sample {
    const PoolCounters pool = devices->current()->pool.counters();
    return {.queue_frames = loop->waiting(),
            .memory_in_use_bytes = pool.bytes_in_use,
            .memory_idle_bytes = pool.bytes_idle,
            .memory_frames_bytes = state->sessions.memory->frames_bytes(),
            .memory_budget_bytes = config.memory_budget_bytes,
            .environment_bytes = state->environments.used_bytes(),
            .environment_budget_bytes = config.environment_budget_bytes,
            .connections = connections.count(),
            .certificate_expires = access->certificate_expires()};
  });
  ASSIGN_OR_RETURN(metrics_server,
                   MetricsServer::start(*metrics, config.metrics, descriptors.probe_connections, clock));
  metrics_address = metrics_server->address();
  return absl::OkStatus();
}

void Server::Impl::open_memory_door() {
  if (std::none_of(config.listen.begin(), config.listen.end(),
                   [](const std::string& address) { return is_unix_address(address); })) {
    return;
  }
  // All processes of this host that may open the sockets are one client, as on gRPC's.
  const ClientId client = absl::HashOf(std::string("local"));
  memory_door = std::make_unique<MemoryDoor>(
      state->regions, state->timers,
      MemoryDoor::Options{.max_connections = size_t{config.max_sessions} + config.max_calls,
                          .hello_limit = handshake_limit(config)},
      [memory = state->sessions.memory, client](uint64_t bytes) {
        return memory->claim_region(client, bytes);
      });
  state->regions.offer();
}

absl::Status Server::Impl::listen() {
  open_memory_door();
  ASSIGN_OR_RETURN(listener, start_grpc(config, descriptors.connections, connections, *access, *metrics,
                                        *service, clock, memory_door.get()));
  health->begin(*listener.server->GetHealthCheckService());
  if (listener.own_doors.empty()) return absl::OkStatus();
  own_door =
      std::make_unique<OwnDoor>(listener.own_doors, clock,
                                OwnDoor::Options{.interval = config.heartbeat_interval,
                                                 .limit = config.heartbeat_limit,
                                                 .dead_limit = kMovingLimits * config.heartbeat_limit},
                                [this](OwnDoor::State door) { health->door(door.answers, door.alive); });
  return absl::OkStatus();
}

absl::StatusOr<FrameReport> Server::Impl::render(const FrameJob& job) {
  absl::StatusOr<FrameReport> report = run_job(job);
  devices->job_ended(job.frame == nullptr ? nullptr : job.frame->renderer.get(), report.status());
  if (job.frame != nullptr) heartbeat->worked(report.ok());
  return report;
}

absl::Status Server::Impl::beat() {
  const std::shared_ptr<Renderer> renderer = devices->renderer();
  const absl::Status status = render_beat(*renderer, *state->sessions.memory);
  // UNAVAILABLE says that frames in flight hold all memory, or that the device is lost already. After any
  // other error, a device without a good frame for heartbeat_limit counts as lost. Some drivers do not report
  // it.
  if (!status.ok() && !absl::IsUnavailable(status) && !health->working()) {
    log_event(LogLevel::kError, "the device renders nothing and counts as lost",
              {{"message", std::string(status.message())}});
    devices->current()->device->lose();
  }
  devices->job_ended(renderer.get(), status);
  return status;
}

absl::Status Server::Impl::render_beat(FrameMaker& renderer, ClientMemory& memory) {
  const Settings settings;
  absl::StatusOr<FrameMemory> frame = renderer.allocate(kBeat, settings);
  // Uploads that stall must not fail the heartbeat.
  if (absl::IsUnavailable(frame.status())) memory.found_no_texture(1, clock.now());
  if (!frame.ok()) return frame.status();
  for (uint32_t y = 0; y < kBeat.height; ++y) {
    const std::span<std::byte> row = frame->input_row(y);
    std::fill(row.begin(), row.end(), std::byte{0});
  }
  return renderer.render(*frame, settings).status();
}

void Server::Impl::stop(absl::Duration grace) {
  own_door.reset();
  listener.accepting.reset();
  if (listener.server != nullptr) {
    state->call_gate.close();
    state->session_gate.close();
    listener.server->Shutdown(absl::ToChronoTime(absl::Now() + grace));
    listener.server->Wait();
  }
  heartbeat->stop();
  loop->stop();
  encoders->stop();
  listener.server.reset();
  memory_door.reset();
  metrics_server.reset();
  metrics->set_sampler({});
}

absl::StatusOr<std::unique_ptr<Server>> Server::start(const Config& asked, Clock& clock, Timers& timers,
                                                      std::function<void()> on_device_gone) {
  RETURN_IF_ERROR(check_config(asked));
  const CgroupLimits cgroup = read_cgroup_limits();
  const MemoryBudget budget = choose_memory_budget(asked.memory_budget_bytes, cgroup);
  const Config config = fit_to_memory(asked, budget);
  ASSIGN_OR_RETURN(TokenKeys keys, config.resume_keys.empty()
                                       ? TokenKeys::random(config.resume_ttl)
                                       : TokenKeys::read(config.resume_keys, config.resume_ttl));
  ASSIGN_OR_RETURN(
      std::unique_ptr<Access> access,
      Access::open({config.tls_cert, config.tls_key, config.tls_client_ca}, config.token_file, clock));
  prepare_driver_environment();
  const auto open = [options = DeviceOptions{.selector = config.device,
                                             .host_without_gpu = config.host_without_gpu,
                                             .validation = config.validation,
                                             .hang_limit = config.hang_limit},
                     bytes = budget.bytes, &clock, executor = config.executor] {
    return open_render_device(options, bytes, clock, executor);
  };
  ASSIGN_OR_RETURN(std::shared_ptr<RenderDevice> device, open());

  auto impl = std::make_unique<Impl>(config, clock, std::move(access));
  impl->keep_device(std::move(device), open, std::move(on_device_gone));
  impl->make_service(std::move(keys), timers);
  impl->watch_health();
  // From here on, ~Server stops the threads if a step fails.
  std::unique_ptr<Server> server(new Server(std::move(impl)));
  server->impl_->descriptors = choose_descriptors(config.max_connections);
  RETURN_IF_ERROR(server->impl_->serve_metrics());
  RETURN_IF_ERROR(server->impl_->listen());
  log_limits(cgroup, budget, server->impl_->descriptors, config);
  return server;
}

Server::Server(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}

Server::~Server() { impl_->stop(absl::ZeroDuration()); }

std::shared_ptr<grpc::Channel> Server::in_process_channel() {
  return impl_->listener.server->InProcessChannel({});
}

const std::vector<std::string>& Server::addresses() const { return impl_->listener.addresses; }

const std::string& Server::metrics_address() const { return impl_->metrics_address; }

bool Server::alive() const { return impl_->health->alive(); }

const std::string& Server::device_name() const { return impl_->state->rendering.device; }

uint64_t Server::validation_messages() const {
  return impl_->devices->current()->device->validation_messages();
}

void Server::lose_device(int times) { impl_->devices->lose(times); }

void Server::refuse_device_memory() { impl_->devices->current()->device->refuse_memory(); }

void Server::hang_device(int submissions) { impl_->devices->current()->device->hang_after(submissions); }

absl::Status Server::occupy_device(std::function<void()> work) { return impl_->loop->post(std::move(work)); }

size_t Server::frames_waiting() const { return impl_->loop->waiting(); }

void Server::drain_and_stop(const std::function<void()>& on_drained) {
  if (impl_->listener.server == nullptr) return;
  impl_->health->drain();
  ServiceState& state = *impl_->state;
  if (!impl_->devices->gone()) impl_->clock.sleep(impl_->config.pre_drain);
  const absl::Time deadline = impl_->clock.now() + impl_->config.drain_timeout;
  StopSign all_left(impl_->clock);
  const std::shared_ptr<Drain> drain =
      Drain::begin(state.call_gate, state.session_gate, state.sessions.table, [&all_left](bool in_time) {
        if (in_time) all_left.give();
      });
  const bool idle = all_left.is_given();
  all_left.comes_within(deadline - impl_->clock.now());
  drain->on_time();
  const bool drained = all_left.is_given();
  if (drained && on_drained) on_drained();
  impl_->stop(!drained ? absl::ZeroDuration() : idle ? kRefusalGrace : kAnswerGrace);
}

}  // namespace candela
