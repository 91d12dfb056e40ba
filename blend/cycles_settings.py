"""The render settings that every comparison needs, set explicitly: factory values differ from all of them."""


def apply_settings(scene, samples, seed, threads):
    """Set engine, sampling and everything that would change or hide radiance. `threads` 0 takes all.

    Camera, film, lights, bounces and the volume integrator are not touched.
    """
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    cycles.device = "CPU"
    render.threads_mode = "FIXED" if threads else "AUTO"
    if threads:
        render.threads = threads

    cycles.samples = samples
    cycles.seed = seed
    cycles.use_animated_seed = False
    cycles.sampling_pattern = "TABULATED_SOBOL"
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.time_limit = 0
    cycles.use_sample_subset = False

    cycles.sample_clamp_direct = 0
    cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.min_light_bounces = 0
    cycles.min_transparent_bounces = 0
    cycles.transparent_max_bounces = 1024
    cycles.use_guiding = False
    cycles.use_fast_gi = False

    render.use_motion_blur = False
    render.use_border = False
    render.use_simplify = False
    render.use_compositing = False
    render.use_sequencer = False
    render.dither_intensity = 0


def apply_exr(image_settings, multilayer, codec):
    """Store images as OpenEXR of 32-bit floats, with all passes if `multilayer`; `codec` is NONE or ZIP."""
    image_settings.media_type = "MULTI_LAYER_IMAGE" if multilayer else "IMAGE"
    image_settings.file_format = "OPEN_EXR_MULTILAYER" if multilayer else "OPEN_EXR"
    image_settings.color_depth = "32"
    image_settings.color_mode = "RGBA"
    image_settings.exr_codec = codec
