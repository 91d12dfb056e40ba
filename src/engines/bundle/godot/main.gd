# Shows the cloud among other things of a scene: drag to go around it, turn the wheel to come closer.
#
# `godot --path FOLDER -- --save PICTURE.exr` draws the scene's own picture (linear, 16 bits a channel) and ends.
extends Node3D

const Cloud := preload("res://cloud.gd")

var cloud := Cloud.new()
var camera := Camera3D.new()
var longitude := 0.0
var latitude := 0.0
var distance := 1.0


func _ready() -> void:
	var failed := cloud.load_from("res://")
	if failed != "":
		push_error(failed)
		get_tree().quit(1)
		return
	var arguments := OS.get_cmdline_user_args()
	var at := arguments.find("--save")
	if at >= 0 and at + 1 < arguments.size():
		await _save(arguments[at + 1], "--from-3d" in arguments)
		return
	camera.environment = _linear()
	add_child(camera)
	add_child(cloud.node(camera))
	_place()


# The scene's picture into a file: of the shader of a canvas, or of the one that stands in a 3-D scene.
func _save(path: String, in_space: bool) -> void:
	var view := SubViewport.new()
	view.size = cloud.size()
	view.use_hdr_2d = true
	view.transparent_bg = true
	view.render_target_update_mode = SubViewport.UPDATE_ALWAYS
	if in_space:
		cloud.place(camera, 0.0, 0.0, 1.0)
		camera.environment = _linear()
		view.own_world_3d = true
		view.add_child(camera)
		view.add_child(cloud.node(camera))
	else:
		view.add_child(cloud.canvas())
	add_child(view)
	for frame in 3:
		await RenderingServer.frame_post_draw
	var image := view.get_texture().get_image()
	var failed := image.save_exr(path)
	if failed != OK:
		push_error("%s cannot be written: error %d" % [path, failed])
	print("%s: %d x %d, format %d" % [path, image.get_width(), image.get_height(), image.get_format()])
	get_tree().quit(0 if failed == OK else 1)


# Colours as they are, black behind them.
func _linear() -> Environment:
	var environment := Environment.new()
	environment.background_mode = Environment.BG_COLOR
	environment.background_color = Color(0, 0, 0, 0)
	environment.tonemap_mode = Environment.TONE_MAPPER_LINEAR
	return environment


func _place() -> void:
	cloud.place(camera, longitude, latitude, distance)


func _unhandled_input(event: InputEvent) -> void:
	if event is InputEventMouseMotion and event.button_mask & MOUSE_BUTTON_MASK_LEFT:
		longitude -= event.relative.x * 0.008
		latitude = clampf(latitude + event.relative.y * 0.008, -1.4, 1.4)
		_place()
	elif event is InputEventMouseButton and event.pressed:
		if event.button_index == MOUSE_BUTTON_WHEEL_UP:
			distance = maxf(distance * 0.9, 0.05)
		elif event.button_index == MOUSE_BUTTON_WHEEL_DOWN:
			distance = minf(distance / 0.9, 20.0)
		_place()
