# A cloud as a bundle of cloudparity has it: its numbers, its texture, and nodes that show it.
#
# `number` and `set_number` read and change the numbers of cloud.json while the program runs.
extends RefCounted

# Blender's axes (x right, y away, z up) in Godot's (y up, z towards one).
const AXES := Basis(Vector3(1, 0, 0), Vector3(0, 0, -1), Vector3(0, 1, 0))

var manifest: Dictionary
var texture: ImageTexture
var materials: Array[ShaderMaterial] = []


# Reads a folder; returns what is wrong, or nothing.
func load_from(folder: String) -> String:
	var path := folder.path_join("cloud.json")
	var found = JSON.parse_string(FileAccess.get_file_as_string(path))
	if not found is Dictionary or found.get("format") != "cloudparity shader 1":
		return "%s is no \"cloudparity shader 1\"" % path
	manifest = found
	var data: Dictionary = manifest["data"]
	var bytes := FileAccess.get_file_as_bytes(folder.path_join(data["file"]))
	if bytes.size() != 4 * int(data["width"]) * int(data["height"]):
		return "%s has %d bytes, not those that cloud.json says" % [data["file"], bytes.size()]
	var image := Image.create_from_data(int(data["width"]), int(data["height"]), false, Image.FORMAT_RGBA8, bytes)
	texture = ImageTexture.create_from_image(image)
	return ""


func size() -> Vector2i:
	return Vector2i(int(manifest["resolution"][0]), int(manifest["resolution"][1]))


func _field(block: String, field: String, element: int) -> Dictionary:
	for one in manifest["blocks"]:
		if one["name"] == block:
			for found in one["elements"][element]:
				if found["name"] == field:
					return found
	push_error("cloud.json has no field %s of %s" % [field, block])
	return {}


func number(block: String, field: String, element: int = 0) -> Array:
	return _field(block, field, element).get("values", [])


func set_number(block: String, field: String, values: Array, element: int = 0) -> void:
	_field(block, field, element)["values"] = values
	for material in materials:
		_give(material)


func _value(field: Dictionary) -> Variant:
	var values: Array = field["values"]
	match values.size():
		1:
			return int(values[0]) if field["kind"] == "u32" else float(values[0])
		2:
			return Vector2(values[0], values[1])
		_:
			return Vector3(values[0], values[1], values[2])


func _give(material: ShaderMaterial) -> void:
	material.set_shader_parameter("cloud_data", texture)
	material.set_shader_parameter("cloud_size", Vector2(size()))
	for block in manifest["blocks"]:
		if int(block["count"]) == 0:
			for field in block["elements"][0]:
				material.set_shader_parameter("cloud_%s_%s" % [block["name"], field["name"]], _value(field))
			continue
		for place in block["elements"][0].size():
			var values := PackedVector3Array()
			for element in block["elements"]:
				values.append(_value(element[place]))
			material.set_shader_parameter("cloud_sun_%s" % block["elements"][0][place]["name"], values)


func _material(shader: String) -> ShaderMaterial:
	var material := ShaderMaterial.new()
	material.shader = load(shader)
	materials.append(material)
	_give(material)
	return material


# The scene's picture, for a canvas of its size.
func canvas() -> ColorRect:
	var rectangle := ColorRect.new()
	rectangle.size = Vector2(size())
	rectangle.material = _material("res://picture.gdshader")
	return rectangle


# The cloud in a 3-D scene: a square before a camera, whose rays look into it. What is in front of the cloud hides it.
func node(camera: Camera3D) -> MeshInstance3D:
	var square := QuadMesh.new()
	square.size = Vector2(2, 2)
	var instance := MeshInstance3D.new()
	instance.mesh = square
	instance.extra_cull_margin = 16384.0
	var material := _material("res://cloud.gdshader")
	instance.material_override = material
	var rows: Array = manifest["camera"]["to_local"]
	var linear := Basis(
		Vector3(rows[0][0], rows[1][0], rows[2][0]),
		Vector3(rows[0][1], rows[1][1], rows[2][1]),
		Vector3(rows[0][2], rows[1][2], rows[2][2])
	)
	var origin := Vector3(rows[0][3], rows[1][3], rows[2][3])
	material.set_shader_parameter("cloud_axes", AXES.inverse())
	material.set_shader_parameter("cloud_to_local", Projection(Transform3D(linear, origin)))
	material.set_shader_parameter("cloud_unit", float(manifest["camera"]["unit"]))
	return instance


func _view(field: String) -> Vector3:
	var values := number("view", field)
	return Vector3(values[0], values[1], values[2])


# Puts a camera where the scene's stands, turned around what it looks at by two angles, its distance multiplied.
func place(camera: Camera3D, longitude: float, latitude: float, distance: float) -> void:
	var picture := Vector2(size())
	var right := _view("direction_across").normalized()
	var above := _view("direction_up").normalized()
	var back := right.cross(above)
	var depth := -_view("direction").dot(back)
	camera.keep_aspect = Camera3D.KEEP_HEIGHT
	camera.fov = rad_to_deg(2.0 * atan(0.5 * _view("direction_up").length() * picture.y / depth))
	var frame: Dictionary = manifest["camera"]
	camera.near = frame["near"]
	camera.far = frame["far"]
	var target := Vector3(frame["target"][0], frame["target"][1], frame["target"][2])
	var away := Vector3(frame["place"][0], frame["place"][1], frame["place"][2]) - target
	var side := Vector3(0, 0, 1).cross(away).normalized()
	var turn := Basis(Vector3(0, 0, 1), longitude) * Basis(side, -latitude)
	var basis := turn * Basis(right, above, back)
	camera.transform = Transform3D(AXES * basis, AXES * (target + turn * away * distance))
