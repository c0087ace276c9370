#include "server/server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <algorithm>
#include <climits>
#include <cstdlib>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/time/clock.h"
#include "proto/candela/v1/address.h"
#include "server/base/cgroup.h"
#include "server/base/driver_environment.h"
#include "server/base/log.h"
#include "server/base/metrics.h"
#include "server/base/units.h"
#include "server/engine.h"
#include "server/listen_address.h"
#include "server/memory_budget.h"
#include "server/render/device/texture_pool.h"
#include "server/render/renderer.h"
#include "server/render/self_test.h"
#include "server/render/settings/tiers.h"
#include "server/rpc/access.h"
#include "server/rpc/backend.h"
#include "server/rpc/health.h"
#include "server/rpc/render_service.h"
#include "server/schedule/heartbeat.h"
#include "server/schedule/render_loop.h"
#include "server/vulkan/device.h"

namespace candela {
namespace {

// For calls that were refused at the last moment to hear so; only those that watch health take it all.
constexpr absl::Duration kRefusalGrace = absl::Milliseconds(500);

// The frame that is rendered to see whether frames come out.
constexpr FrameDesc kBeat = {8, 8, kUsualFormat};

// How many limits of health the render thread may take for one frame before it counts as stuck.
constexpr int kMovingLimits = 4;

// How long a connection may take for its first bytes: the idle timeout, but time for a busy machine, and at
// most gRPC's own limit.
constexpr v1::Range<absl::Duration> kHandshake{absl::Seconds(3), absl::Minutes(2)};

// Clients may ask for a sign of life once a second (SessionOptions::ping_interval), give or take.
constexpr int kPingIntervalMs = 500;

// How often a silent connection is asked for a sign of life. gRPC takes the kernel's word that all was read,
// and the kernel says so of a connection that is reset right behind its last bytes (TCP_INQ); it shows only
// when something is sent. How long an answer may take is the idle timeouts' matter: it may have to wait
// behind a frame.
constexpr int kSignOfLifeMs = 5000;

constexpr int kMaxThreads = 16;    // of gRPC's synchronous services
constexpr int kOtherStreams = 64;  // on one connection, beside calls with frames

FrameLimits limits_of(const Config& config, const DeviceSummary& device) {
  return {config.max_dimension, std::min(config.max_frame_bytes, device.max_allocation_bytes)};
}

v1::GetServerInfoResponse server_info(const Config& config, const DeviceSummary& device) {
  v1::GetServerInfoResponse info;
  info.set_version(CANDELA_VERSION);
  v1::DeviceInfo& about = *info.mutable_device();
  about.set_name(device.name);
  about.set_type(device.type);
  about.set_driver(device.driver);
  about.set_api_version(device.api_version);
  about.set_unified_memory(device.unified_memory);
  for (int i = 1; v1::PixelFormat_IsValid(i); ++i) info.add_formats(static_cast<v1::PixelFormat>(i));
  for (int i = 1; v1::OutputFormat_IsValid(i); ++i) info.add_output_formats(static_cast<v1::OutputFormat>(i));
  for (int i = 1; v1::ToneCurve_IsValid(i); ++i) info.add_curves(static_cast<v1::ToneCurve>(i));
  for (int i = 1; v1::Transfer_IsValid(i); ++i) info.add_transfers(static_cast<v1::Transfer>(i));
  for (const Tier& tier : tiers()) {
    v1::Tier& row = *info.add_tiers();
    row.set_name(tier.name);
    row.set_summary(tier.summary);
  }
  const FrameLimits limits = limits_of(config, device);
  info.mutable_limits()->set_max_frame_bytes(limits.max_frame_bytes);
  info.mutable_limits()->set_max_dimension(limits.max_dimension);
  info.mutable_limits()->set_max_band_bytes(v1::kMaxBandBytes);
  info.mutable_limits()->set_memory_budget_bytes(config.memory_budget_bytes);
  info.mutable_limits()->set_max_sessions(config.max_sessions);
  info.mutable_limits()->set_max_frames_in_flight(config.max_frames_in_flight);
  return info;
}

// The address with the port that was taken, which matters for port 0.
std::string with_port(const std::string& address, int port) {
  if (v1::is_unix_address(address)) return address;
  return absl::StrCat(address.substr(0, address.rfind(':') + 1), port);
}

// Of the software device, and of the tier that runs on the host.
std::string threads() {
  const char* of_device = std::getenv("LP_NUM_THREADS");
  return absl::StrCat(usable_cpus(), " ", of_device == nullptr ? "all" : of_device);
}

void log_limits(const CgroupLimits& limits, const MemoryBudget& budget, const Config& config) {
  log_event(LogLevel::kInfo, "limits",
            {{"cpus", uint64_t{usable_cpus(limits)}},
             {"cpus_from", limits.cpus ? absl::StrFormat("%g of %s", *limits.cpus, limits.cpus_from)
                                       : "those it may run on"},
             {"memory_budget", format_bytes(budget.bytes)},
             {"memory_budget_from", budget.from},
             {"sessions", uint64_t{config.max_sessions}},
             {"calls", uint64_t{config.max_calls}}});
  if (!budget.beyond_the_limit) return;
  log_event(LogLevel::kWarning,
            "memory-budget is more than this process may take; it will be killed and not refuse",
            {{"limit", format_bytes(*limits.memory_bytes)}, {"limit_from", limits.memory_from}});
}

}  // namespace

struct Server::Parts {
  explicit Parts(const Config& c) : config(c) {}

  absl::Status listen();
  absl::Status serve_metrics();
  // On the render thread.
  absl::StatusOr<FrameReport> render(Frame& frame);
  absl::Status beat();
  // Calls that still run after `grace` are cancelled.
  void stop(absl::Duration grace);

  const Config config;
  std::unique_ptr<Access> access;
  std::unique_ptr<Metrics> metrics;
  std::unique_ptr<EngineKeeper> engines;
  std::unique_ptr<TierBenchmark> tier_meter;
  std::unique_ptr<RenderLoop> loop;
  std::unique_ptr<WorkerPool> encoders;
  std::unique_ptr<Backend> backend;
  std::unique_ptr<RenderService> service;
  std::unique_ptr<grpc::Server> grpc;
  std::vector<std::string> addresses;
  std::unique_ptr<Health> health;
  std::unique_ptr<Heartbeat> heartbeat;
  std::unique_ptr<MetricsServer> metrics_server;
  std::string metrics_address;
};

absl::Status Server::Parts::listen() {
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ServerBuilder builder;
  builder.RegisterService(service.get());
  builder.SetMaxReceiveMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  builder.SetMaxSendMessageSize(static_cast<int>(v1::kMaxMessageBytes));
  // A compressed message could unfold to far more than the limit.
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_GZIP, false);
  builder.SetCompressionAlgorithmSupportStatus(GRPC_COMPRESS_DEFLATE, false);
  // Two servers on one port would share its calls between them unasked.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  // Reflection is a synchronous service and takes a thread a stream; health may be watched without end.
  grpc::ResourceQuota quota("candelad");
  quota.SetMaxThreads(kMaxThreads);
  builder.SetResourceQuota(quota);
  // What lies in gRPC unread is bounded by this alone. A memory quota would end calls, and clients with them,
  // and not hold them back.
  builder.AddChannelArgument(GRPC_ARG_HTTP2_BDP_PROBE, 0);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, kLookAheadBytes);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS,
                             static_cast<int>(config.max_calls + config.max_sessions) + kOtherStreams);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, kPingIntervalMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kSignOfLifeMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, INT_MAX);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);
  builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS,
                             static_cast<int>(absl::ToInt64Milliseconds(
                                 std::clamp(config.idle_timeout, kHandshake.min, kHandshake.max))));
  std::vector<int> ports(config.listen.size(), 0);
  for (const std::string& address : config.listen) {
    if (absl::Status status = check_socket_is_free(address); !status.ok()) return status;
  }
  for (size_t i = 0; i < ports.size(); ++i) {
    builder.AddListeningPort(config.listen[i], access->credentials(config.listen[i], *metrics), &ports[i]);
  }
  grpc = builder.BuildAndStart();
  for (size_t i = 0; i < ports.size(); ++i) {
    if (ports[i] == 0) {
      return absl::UnavailableError(
          absl::StrFormat("cannot listen on %s: it is in use or not an address of this machine; stop what "
                          "listens there or pass "
                          "another --listen",
                          config.listen[i]));
    }
    addresses.push_back(with_port(config.listen[i], ports[i]));
  }
  if (grpc == nullptr) return absl::InternalError("gRPC did not start");
  return absl::OkStatus();
}

absl::Status Server::Parts::serve_metrics() {
  if (config.metrics.empty()) return absl::OkStatus();
  metrics->set_sampler([this]() -> Metrics::Sample {
    const PoolCounters pool = engines->engine()->pool.counters();
    return {loop->waiting(), pool.bytes_in_use, pool.bytes_idle, backend->memory_budget_bytes};
  });
  absl::StatusOr<std::unique_ptr<MetricsServer>> started = MetricsServer::start(*metrics, config.metrics);
  if (!started.ok()) return started.status();
  metrics_server = *std::move(started);
  metrics_address = metrics_server->address();
  return absl::OkStatus();
}

absl::StatusOr<FrameReport> Server::Parts::render(Frame& frame) {
  absl::StatusOr<FrameReport> report = render_frame(frame);
  engines->worked(*frame.renderer, report.status());
  heartbeat->worked(report.ok());
  return report;
}

absl::Status Server::Parts::beat() {
  const std::shared_ptr<Renderer> renderer = engines->renderer();
  const Settings settings;
  absl::StatusOr<FrameMemory> memory = renderer->allocate(kBeat, settings);
  if (!memory.ok()) return memory.status();
  for (uint32_t y = 0; y < kBeat.height; ++y) {
    const std::span<std::byte> row = memory->input_row(y);
    std::fill(row.begin(), row.end(), std::byte{0});
  }
  const absl::Status status = renderer->render(*memory, settings).status();
  engines->worked(*renderer, status);
  return status;
}

void Server::Parts::stop(absl::Duration grace) {
  if (grpc != nullptr) {
    backend->gate.close();
    backend->session_gate.close();
    grpc->Shutdown(absl::ToChronoTime(absl::Now() + grace));
    grpc->Wait();
  }
  heartbeat->stop();
  loop->stop();
  encoders->stop();
  grpc.reset();
  metrics_server.reset();
  metrics->set_sampler({});
}

absl::StatusOr<std::unique_ptr<Server>> Server::start(const Config& asked,
                                                      std::function<void()> on_device_gone) {
  if (absl::Status status = check_config(asked); !status.ok()) return status;
  const CgroupLimits cgroup = read_cgroup_limits();
  const MemoryBudget budget = choose_memory_budget(asked.memory_budget_bytes, cgroup);
  Config config = asked;
  config.memory_budget_bytes = budget.bytes;
  config.max_sessions = std::min(config.max_sessions, budget.most_sessions);
  config.max_calls = std::min(config.max_calls, budget.most_sessions);
  absl::StatusOr<TokenKeys> keys = config.resume_keys.empty()
                                       ? TokenKeys::random(config.resume_ttl)
                                       : TokenKeys::read(config.resume_keys, config.resume_ttl);
  if (!keys.ok()) return keys.status();
  absl::StatusOr<std::unique_ptr<Access>> access =
      Access::open({config.tls_cert, config.tls_key, config.tls_client_ca}, config.token_file);
  if (!access.ok()) return access.status();
  prepare_driver_environment();
  const auto start_one = [options = DeviceOptions{.selector = config.device, .validation = config.validation},
                          bytes = budget.bytes] { return start_engine(options, bytes); };
  absl::StatusOr<std::shared_ptr<Engine>> engine = start_one();
  if (!engine.ok()) return engine.status();

  auto parts = std::make_unique<Parts>(config);
  const DeviceSummary& device = (*engine)->device->summary();
  parts->access = *std::move(access);
  parts->metrics = std::make_unique<Metrics>(CANDELA_VERSION, device.name, device.driver);
  parts->engines =
      std::make_unique<EngineKeeper>(*engine, start_one, *parts->metrics, std::move(on_device_gone));
  const auto renderer = [engines = parts->engines.get()] { return engines->renderer(); };
  parts->tier_meter = std::make_unique<TierBenchmark>(
      renderer, absl::StrCat(CANDELA_VERSION, "|", device.name, "|", device.driver, "|", threads()),
      config.cache_dir.empty() ? "" : absl::StrCat(config.cache_dir, "/tiers.json"));
  parts->loop = std::make_unique<RenderLoop>(
      [p = parts.get()](Frame& frame) { return p->render(frame); },
      config.max_calls + config.max_sessions * (config.max_frames_in_flight + v1::kLookahead.max));
  parts->encoders = std::make_unique<WorkerPool>(config.encoder_threads);
  parts->backend.reset(new Backend{.renderer = renderer,
                                   .loop = *parts->loop,
                                   .tier_meter = *parts->tier_meter,
                                   .limits = limits_of(config, device),
                                   .idle_timeout = config.idle_timeout,
                                   .max_frames_in_flight = config.max_frames_in_flight,
                                   .memory_budget_bytes = config.memory_budget_bytes,
                                   .device = device.name,
                                   .encoders = *parts->encoders,
                                   .keys = *std::move(keys),
                                   .metrics = *parts->metrics,
                                   .gate = CallGate("calls", config.max_calls),
                                   .session_gate = CallGate("sessions", config.max_sessions),
                                   .lookahead_memory = LookaheadMemory(config.memory_budget_bytes)});
  parts->service = std::make_unique<RenderService>(
      *parts->backend, [engines = parts->engines.get()] { return engines->engine()->pool.counters(); },
      server_info(config, device));
  parts->health = std::make_unique<Health>(*parts->metrics);
  parts->heartbeat = std::make_unique<Heartbeat>(
      *parts->loop, [p = parts.get()] { return p->beat(); },
      Heartbeat::Options{.interval = config.heartbeat_interval,
                         .limit = config.heartbeat_limit,
                         .moving_limit = kMovingLimits * config.heartbeat_limit},
      [p = parts.get()](Heartbeat::Pulse pulse) { p->health->pulse(pulse.working, pulse.moving); });
  // From here on Server stops what runs, whatever fails.
  std::unique_ptr<Server> server(new Server(std::move(parts)));
  Parts& running = *server->parts_;
  if (absl::Status status = running.serve_metrics(); !status.ok()) return status;
  if (absl::Status status = running.listen(); !status.ok()) return status;
  running.health->begin(*running.grpc->GetHealthCheckService());
  log_limits(cgroup, budget, config);
  return server;
}

Server::Server(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}

Server::~Server() { parts_->stop(absl::ZeroDuration()); }

std::shared_ptr<grpc::Channel> Server::in_process_channel() { return parts_->grpc->InProcessChannel({}); }

const std::vector<std::string>& Server::addresses() const { return parts_->addresses; }

const std::string& Server::metrics_address() const { return parts_->metrics_address; }

bool Server::alive() const { return parts_->health->alive(); }

const std::string& Server::device_name() const { return parts_->backend->device; }

uint64_t Server::validation_messages() const {
  return parts_->engines->engine()->device->validation_messages();
}

void Server::lose_device(int times) { parts_->engines->lose(times); }

void Server::drain_and_stop(const std::function<void()>& on_drained) {
  if (parts_->grpc == nullptr) return;
  parts_->health->drain();
  Backend& backend = *parts_->backend;
  if (!parts_->engines->gone()) absl::SleepFor(parts_->config.pre_drain);
  const absl::Time deadline = absl::Now() + parts_->config.drain_timeout;
  backend.gate.close();
  backend.session_gate.close();
  for (const std::shared_ptr<SessionCall>& session : backend.sessions.all()) session->go_away();
  const bool drained = backend.gate.wait_until_empty(deadline - absl::Now()) &&
                       backend.session_gate.wait_until_empty(deadline - absl::Now());
  if (drained && on_drained) on_drained();
  parts_->stop(drained ? kRefusalGrace : absl::ZeroDuration());
}

}  // namespace candela
