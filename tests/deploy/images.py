"""What is in the images that deploy/Containerfile makes, and its variants beside the shipped one."""
import pathlib

import podman
from podman import expect


def in_image(*command: str, image: str = podman.IMAGE) -> str:
    """Runs a command in the image as root, who can read every file."""
    return podman.podman("run", "--rm", "--network=none", "--user=0", f"--entrypoint={command[0]}", image, *command[1:])


def drivers_of(image: str) -> list[str]:
    return sorted(in_image("find", "/usr", "-name", "libvulkan_*.so", image=image).splitlines())


def expect_libraries(image: str, *programs: str) -> None:
    unfit = [line for program in programs for line in in_image("ldd", program, image=image).splitlines() if "not found" in line]
    expect(not unfit, f"libraries are missing: {unfit}")


def check_gpu_image(version: str) -> None:
    podman.build_gpu_image(version)
    drivers = drivers_of(podman.GPU_IMAGE)
    names = {pathlib.Path(driver).name for driver in drivers}
    expect({"libvulkan_radeon.so", "libvulkan_intel.so", "libvulkan_lvp.so"} <= names, f"it has {names}")
    expect_libraries(podman.GPU_IMAGE, *drivers)
    listed = podman.podman("run", "--rm", "--network=none", *podman.AS_SHIPPED, "--entrypoint=candelad", podman.GPU_IMAGE, "--list-devices")
    expect("llvmpipe" in listed, f"without a GPU it runs on something else than lavapipe:\n{listed}")


def check_host_image(version: str) -> None:
    podman.build_host_image(version)
    sizes = [int(podman.podman("image", "inspect", "--format", "{{.Size}}", image)) for image in (podman.HOST_IMAGE, podman.IMAGE)]
    print(f"{sizes[0] / 1e6:.0f} MB instead of {sizes[1] / 1e6:.0f}")
    expect(sizes[0] < 0.6 * sizes[1], f"it has {sizes[0]} bytes, and the other {sizes[1]}")
    found = in_image("find", "/usr", "-name", "libvulkan*", "-o", "-name", "libLLVM*", image=podman.HOST_IMAGE)
    expect(found == "", f"it has Vulkan:\n{found}")
    expect_libraries(podman.HOST_IMAGE, "/usr/bin/candela", "/usr/bin/candelad")
    script = ("candelad & candela sample s.exr --size 64x64 -q && candela render s.exr s.png && "
              "until candela health --server $PROXY_SERVER; do sleep 0.1; done; candela info --server $PROXY_SERVER")
    said = podman.podman("run", "--rm", "--network=none", *podman.AS_SHIPPED, "--entrypoint=sh", podman.HOST_IMAGE, "-c", script)
    expect("there is no Vulkan device" in said, f"candelad has one, or does not serve:\n{said}")
