--[[ Edit with bokehnet: renders the selected pictures of darktable and imports the results into its library.

Copy this file to the folder lua/ of darktable's configuration and add  require "bokehnet"  to its luarc.
The depth of a picture is a file in its folder with its name and .disparity.png, .disparity.exr (larger is nearer)
or .depth.exr (metres); without one the picture must contain its depth, as phone photos do. The depth must show the
same view as the picture: crop and rotate after bokehnet, not before.
]]

local dt = require "darktable"

local NAME = "bokehnet"
local bokehnet = {}

local PREFERENCES = {
  command = { "bokehnet: program", "the command line of bokehnet", "bokehnet" },
  options = { "bokehnet: options", "options of bokehnet render; empty: its defaults", "" },
}

if dt.gui then -- darktable-cli has no preferences to register
  for name, entry in pairs(PREFERENCES) do
    dt.preferences.register(NAME, name, "string", entry[1], entry[2], entry[3])
  end
end

local function preference(name)
  local value = dt.preferences.read(NAME, name, "string")
  return value ~= "" and value or PREFERENCES[name][3]
end

local function quoted(text)
  return "'" .. text:gsub("'", "'\\''") .. "'"
end

local function readable(path)
  local file = io.open(path, "rb")
  if file then file:close() end
  return file ~= nil
end

-- Return the options for the depth file of a picture; empty if the picture must contain its depth.
local function depth_options(path)
  local stem = path:gsub("%.[^./\\]+$", "")
  for _, ending in ipairs { ".disparity.png", ".disparity.exr" } do
    if readable(stem .. ending) then return "--resize-disparity --disparity " .. quoted(stem .. ending) end
  end
  if readable(stem .. ".depth.exr") then return "--resize-disparity --depth " .. quoted(stem .. ".depth.exr") end
  return ""
end

-- Render an exported file; return the path of the result, or nil and a one-line error.
function bokehnet.render_file(exported, original, output)
  local errors = os.tmpname()
  local words = {
    preference("command"), "render", quoted(exported), "-o", quoted(output),
    depth_options(original), preference("options"), "--quiet",
    "> /dev/null 2>", quoted(errors),
  }
  local done = os.execute(table.concat(words, " "))
  local file = io.open(errors)
  local line = file and file:read("l") or nil
  if file then file:close() end
  os.remove(errors)
  if done then return output end
  return nil, line or "bokehnet: expected a program that runs, found none; set it in the preferences"
end

-- Export a picture of the library with its edits, render it, and import the result into the same folder.
function bokehnet.edit(image)
  local original = image.path .. "/" .. image.filename
  local exported = os.tmpname() .. ".tif"
  local format = dt.new_format("tiff")
  format.bpp = 16
  format:write_image(image, exported)
  local output = original:gsub("%.[^./\\]+$", "") .. ".bokeh.tif"
  local result, message = bokehnet.render_file(exported, original, output)
  os.remove(exported)
  if not result then
    dt.print_error(message)
    if dt.gui then dt.print(message) end
    return nil, message
  end
  local imported = dt.database.import(result)
  if imported then imported:group_with(image.group_leader) end
  return result
end

local function edit_all(_, images)
  for index, image in ipairs(images) do
    dt.print(string.format("bokehnet: %d of %d", index, #images))
    bokehnet.edit(image)
  end
end

if dt.gui then
  dt.gui.libs.image.register_action(NAME, "edit with bokehnet", edit_all, "render the blur of a lens")
end

return bokehnet
