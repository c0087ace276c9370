// The calls about environments, on any channel. Errors are as Connection's.
#pragma once

#include <grpcpp/channel.h>

#include <memory>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "absl/time/time.h"
#include "client/environment.h"
#include "client/security.h"

namespace candela {

// Asks for the environment by its id first, and sends the pixels only to a server that does not have it.
absl::StatusOr<v1::Environment> put_environment(const std::shared_ptr<grpc::Channel>& channel,
                                                const Peer& peer, const Panorama& panorama,
                                                absl::Time deadline);

absl::StatusOr<v1::Environment> get_environment(const std::shared_ptr<grpc::Channel>& channel,
                                                const Peer& peer, const std::string& id, absl::Time deadline);

absl::StatusOr<EnvironmentBake> bake_environment(const std::shared_ptr<grpc::Channel>& channel,
                                                 const Peer& peer, const v1::BakeEnvironmentRequest& request,
                                                 absl::Time deadline);

absl::StatusOr<v1::DropEnvironmentResponse> drop_environment(const std::shared_ptr<grpc::Channel>& channel,
                                                             const Peer& peer, const std::string& id,
                                                             absl::Time deadline);

}  // namespace candela
