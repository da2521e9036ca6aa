//! The table of [`CATEGORIES`].

use harmony_scene::{Level, MaterialCategory};

use super::{Back, Category};

/// All categories.
#[rustfmt::skip] // one line a category
pub static CATEGORIES: &[Category] = &[
    row("sofa", Level::Furniture, [2.1, 0.85, 0.92], [1.1, 0.55, 0.6], [4.2, 1.3, 2.6], MaterialCategory::Fabric, "fb", None, &["loveseat", "settee", "sofa bed", "sectional", "divan", "chesterfield", "davenport", "futon", "sofabed", "daybed", "chaise longue", "chaise", "recliner sofa", "couch", "three-seater", "two-seater"]),
    row("armchair", Level::Furniture, [0.85, 0.85, 0.85], [0.5, 0.6, 0.5], [1.4, 1.4, 1.3], MaterialCategory::Fabric, "fb", None, &["lounge chair", "easy chair", "accent chair", "recliner", "wing chair", "wingback", "club chair", "tub chair", "arm chair", "rocking chair", "glider", "papasan", "reading chair", "barrel chair", "side armchair"]),
    row("chair", Level::Furniture, [0.46, 0.88, 0.52], [0.3, 0.6, 0.3], [0.8, 1.3, 0.9], MaterialCategory::Wood, "fb", None, &["dining chair", "side chair", "kitchen chair", "wooden chair", "folding chair", "visitor chair", "seat", "high chair"]),
    row("office_chair", Level::Furniture, [0.62, 1.05, 0.62], [0.4, 0.75, 0.4], [0.85, 1.4, 0.85], MaterialCategory::Fabric, "fb", None, &["desk chair", "swivel chair", "gaming chair", "task chair", "computer chair", "rolling chair", "ergonomic chair"]),
    row("stool", Level::Furniture, [0.38, 0.6, 0.38], [0.2, 0.25, 0.2], [0.6, 1.2, 0.6], MaterialCategory::Wood, "s", None, &["bar stool", "barstool", "counter stool", "step stool", "footstool", "bar chair"]),
    row("bench", Level::Furniture, [1.2, 0.45, 0.4], [0.5, 0.25, 0.2], [2.6, 1.1, 0.8], MaterialCategory::Wood, "fsb", None, &["window seat", "entry bench", "bed bench", "storage bench", "piano bench"]),
    row("ottoman", Level::Furniture, [0.65, 0.42, 0.6], [0.3, 0.2, 0.3], [1.6, 0.65, 1.2], MaterialCategory::Fabric, "s", None, &["pouf", "pouffe", "hassock", "footrest", "tuffet"]),
    row("bean_bag", Level::Furniture, [0.85, 0.75, 0.9], [0.5, 0.4, 0.5], [1.3, 1.1, 1.3], MaterialCategory::Fabric, "f", None, &["beanbag", "bean bag chair"]),
    row("bed", Level::Furniture, [1.6, 1.1, 2.1], [0.8, 0.35, 1.6], [2.3, 1.9, 2.5], MaterialCategory::Fabric, "fsb", None, &["double bed", "single bed", "king bed", "queen bed", "twin bed", "bedstead", "bed frame", "mattress"]),
    row("crib", Level::Furniture, [0.7, 0.95, 1.3], [0.5, 0.6, 0.9], [0.9, 1.3, 1.6], MaterialCategory::Wood, "f", None, &["cot", "baby bed", "playpen"]),
    row("nightstand", Level::Furniture, [0.48, 0.55, 0.42], [0.25, 0.3, 0.22], [0.8, 0.9, 0.7], MaterialCategory::Wood, "fsc", None, &["night stand", "bedside table", "bedside cabinet", "night table", "bedside"]),
    row("dresser", Level::Furniture, [1.2, 0.85, 0.48], [0.4, 0.5, 0.3], [2.2, 1.6, 0.75], MaterialCategory::Wood, "fsc", None, &["chest of drawers", "drawer chest", "drawers", "commode", "bureau", "tallboy", "chest", "drawer unit"]),
    row("cabinet", Level::Furniture, [1.4, 0.8, 0.43], [0.3, 0.3, 0.2], [3.2, 2.4, 0.8], MaterialCategory::Wood, "fsc", None, &["sideboard", "credenza", "buffet", "cupboard", "storage cabinet", "shoe cabinet", "display cabinet", "filing cabinet", "file cabinet", "locker", "china cabinet", "hutch", "media cabinet", "storage unit", "trunk"]),
    row("tv_stand", Level::Furniture, [1.6, 0.5, 0.42], [0.6, 0.25, 0.25], [3.0, 0.9, 0.7], MaterialCategory::Wood, "fsc", None, &["tv console", "tv cabinet", "tv unit", "television stand", "tv bench", "media console", "entertainment center", "entertainment unit", "media unit", "lowboard", "tv table"]),
    row("wardrobe", Level::Furniture, [1.5, 2.1, 0.6], [0.6, 1.5, 0.4], [3.6, 2.8, 0.9], MaterialCategory::Wood, "fc", None, &["closet", "armoire", "sliding wardrobe"]),
    row("bookshelf", Level::Furniture, [0.85, 1.9, 0.32], [0.3, 0.5, 0.18], [3.6, 2.8, 0.6], MaterialCategory::Wood, "fsc", None, &["bookcase", "book shelf", "book case", "shelving unit", "shelving", "shelves", "shelf unit", "etagere", "open shelf", "rack", "storage rack", "shoe rack", "display shelf"]),
    row("wall_shelf", Level::Wall, [0.8, 0.22, 0.22], [0.2, 0.02, 0.08], [2.4, 1.6, 0.45], MaterialCategory::Wood, "fs", None, &["floating shelf", "wall mounted shelf", "wall-mounted shelf", "shelf", "ledge", "picture ledge", "corner shelf"]),
    row("kitchen_base", Level::Furniture, [2.4, 0.9, 0.62], [0.4, 0.7, 0.45], [6.0, 1.1, 1.2], MaterialCategory::Wood, "fs", None, &["kitchen counter", "kitchen island", "base cabinet", "kitchen cabinet", "lower cabinet", "kitchen cabinets", "counter", "countertop", "kitchen unit", "kitchenette", "bar counter", "island"]),
    row("kitchen_wall", Level::Wall, [1.8, 0.7, 0.35], [0.3, 0.3, 0.2], [5.0, 1.2, 0.6], MaterialCategory::Wood, "f", None, &["wall cabinet", "upper cabinet", "overhead cabinet", "hanging cabinet", "medicine cabinet", "kitchen wall cabinet"]),
    row("fridge", Level::Furniture, [0.7, 1.8, 0.7], [0.45, 0.6, 0.45], [1.1, 2.2, 0.95], MaterialCategory::Metal, "fsc", None, &["refrigerator", "freezer", "mini fridge", "icebox"]),
    row("oven", Level::Furniture, [0.6, 0.9, 0.62], [0.4, 0.4, 0.4], [1.0, 1.1, 0.8], MaterialCategory::Metal, "fsc", None, &["stove", "cooker", "range", "cooktop", "hob", "gas stove"]),
    row("microwave", Level::Decoration, [0.5, 0.3, 0.38], [0.35, 0.2, 0.25], [0.65, 0.45, 0.55], MaterialCategory::Metal, "fs", None, &["microwave oven", "toaster oven", "toaster"]),
    row("washing_machine", Level::Furniture, [0.6, 0.85, 0.6], [0.45, 0.7, 0.45], [0.75, 1.1, 0.75], MaterialCategory::Metal, "fsc", None, &["washer", "dryer", "tumble dryer", "laundry machine", "washing machine"]),
    row("dishwasher", Level::Furniture, [0.6, 0.85, 0.6], [0.4, 0.7, 0.45], [0.7, 0.95, 0.7], MaterialCategory::Metal, "fsc", None, &[]),
    row("range_hood", Level::Wall, [0.75, 0.7, 0.5], [0.45, 0.2, 0.3], [1.2, 1.2, 0.7], MaterialCategory::Metal, "f", None, &["cooker hood", "extractor hood", "kitchen hood", "hood", "exhaust hood"]),
    row("dining_table", Level::Furniture, [1.8, 0.75, 0.95], [0.6, 0.6, 0.5], [3.6, 0.95, 1.6], MaterialCategory::Wood, "s", None, &["table", "kitchen table", "conference table", "meeting table", "folding table", "work table", "pool table"]),
    row("coffee_table", Level::Furniture, [1.1, 0.42, 0.6], [0.4, 0.25, 0.3], [1.8, 0.6, 1.3], MaterialCategory::Wood, "s", None, &["cocktail table", "tea table", "low table", "center table", "centre table"]),
    row("round_table", Level::Furniture, [1.1, 0.75, 1.1], [0.4, 0.35, 0.4], [1.9, 0.95, 1.9], MaterialCategory::Wood, "s", None, &["round dining table", "bistro table", "pedestal table", "circular table"]),
    row("desk", Level::Furniture, [1.4, 0.75, 0.65], [0.7, 0.6, 0.4], [2.6, 1.2, 1.1], MaterialCategory::Wood, "fs", None, &["writing desk", "computer desk", "office desk", "study desk", "work desk", "workstation", "vanity table", "dressing table", "secretary", "study table", "makeup table"]),
    row("side_table", Level::Furniture, [0.48, 0.55, 0.48], [0.22, 0.3, 0.22], [0.9, 0.8, 0.9], MaterialCategory::Wood, "s", None, &["end table", "accent table", "lamp table", "plant stand", "small table", "occasional table", "tray table", "sofa table"]),
    row("console_table", Level::Furniture, [1.2, 0.8, 0.35], [0.5, 0.55, 0.2], [2.4, 1.0, 0.6], MaterialCategory::Wood, "fs", None, &["hall table", "entry table", "entryway table", "hallway table", "console"]),
    row("piano", Level::Furniture, [1.5, 1.2, 0.62], [1.2, 0.7, 0.5], [1.7, 1.4, 1.9], MaterialCategory::Wood, "fs", None, &["upright piano", "grand piano", "organ", "digital piano"]),
    row("floor_lamp", Level::Furniture, [0.42, 1.55, 0.42], [0.15, 0.9, 0.15], [1.0, 2.2, 1.0], MaterialCategory::Metal, "", Some("shade"), &["standing lamp", "torchiere", "standard lamp", "floor light", "uplighter"]),
    row("tripod_lamp", Level::Furniture, [0.6, 1.5, 0.6], [0.3, 0.8, 0.3], [0.9, 1.9, 0.9], MaterialCategory::Wood, "", Some("shade"), &["tripod floor lamp"]),
    row("arc_lamp", Level::Furniture, [1.2, 1.9, 0.4], [0.5, 1.2, 0.2], [2.2, 2.4, 0.7], MaterialCategory::Metal, "", Some("shade"), &["arc floor lamp", "arched lamp", "arching lamp"]),
    row("table_lamp", Level::Decoration, [0.34, 0.52, 0.34], [0.1, 0.18, 0.1], [0.6, 0.95, 0.6], MaterialCategory::Ceramic, "", Some("shade"), &["lamp", "bedside lamp", "night lamp", "nightstand lamp", "lantern", "buffet lamp"]),
    row("desk_lamp", Level::Decoration, [0.2, 0.45, 0.42], [0.1, 0.2, 0.15], [0.5, 0.8, 0.8], MaterialCategory::Metal, "f", Some("shade"), &["reading lamp", "task lamp", "work lamp", "study lamp", "gooseneck lamp"]),
    row("pendant", Level::Ceiling, [0.4, 0.8, 0.4], [0.1, 0.2, 0.1], [1.2, 1.8, 1.2], MaterialCategory::Metal, "", Some("shade"), &["pendant light", "pendant lamp", "hanging lamp", "hanging light", "suspended lamp", "drop light", "hanging pendant", "light bulb"]),
    row("chandelier", Level::Ceiling, [0.8, 0.75, 0.8], [0.35, 0.3, 0.35], [1.6, 1.8, 1.6], MaterialCategory::Metal, "", Some("shade"), &["candelabra"]),
    row("ceiling_light", Level::Ceiling, [0.42, 0.12, 0.42], [0.08, 0.02, 0.08], [1.6, 0.35, 1.6], MaterialCategory::Glass, "", Some("shade"), &["flush mount", "ceiling lamp", "ceiling fixture", "light fixture", "flush light", "downlight", "recessed light", "spotlight", "track light", "led panel", "smoke detector", "recessed lights"]),
    row("ceiling_fan", Level::Ceiling, [1.3, 0.42, 1.3], [0.7, 0.2, 0.7], [1.9, 0.9, 1.9], MaterialCategory::Wood, "", Some("shade"), &["fan with light"]),
    row("wall_sconce", Level::Wall, [0.2, 0.32, 0.22], [0.06, 0.1, 0.05], [0.5, 0.8, 0.45], MaterialCategory::Metal, "f", Some("shade"), &["sconce", "wall lamp", "wall light", "vanity light", "bracket light", "wall-mounted lamp", "picture light"]),
    row("rug", Level::Furniture, [2.3, 0.012, 1.6], [0.4, 0.004, 0.3], [6.0, 0.06, 5.0], MaterialCategory::Fabric, "ps", None, &["carpet", "area rug", "mat", "doormat", "floor mat", "bath mat", "runner", "round rug", "door mat", "yoga mat"]),
    row("curtain", Level::Wall, [2.2, 2.3, 0.14], [0.3, 0.5, 0.04], [5.0, 3.2, 0.4], MaterialCategory::Fabric, "f", None, &["curtains", "drapes", "drape", "drapery", "drapery panel", "sheer", "shower curtain"]),
    row("blind", Level::Wall, [1.2, 1.4, 0.06], [0.3, 0.3, 0.02], [3.5, 2.8, 0.15], MaterialCategory::Fabric, "f", None, &["blinds", "roller shade", "roman shade", "window shade", "venetian blind", "shutter", "roller blind", "shutters", "window blind"]),
    row("window", Level::Wall, [1.3, 1.4, 0.12], [0.3, 0.3, 0.03], [5.0, 3.0, 0.4], MaterialCategory::Glass, "fp", None, &["window frame", "bay window", "skylight", "french window"]),
    row("door", Level::Wall, [0.92, 2.08, 0.12], [0.5, 1.6, 0.03], [2.6, 2.7, 0.35], MaterialCategory::Wood, "fp", None, &["doorway", "sliding door", "french door", "french doors", "glass door", "wooden door", "entrance", "patio door", "closet door", "interior door"]),
    row("painting", Level::Wall, [0.7, 0.55, 0.03], [0.08, 0.08, 0.005], [3.0, 2.2, 0.1], MaterialCategory::Paper, "fp", None, &["picture", "picture frame", "poster", "artwork", "wall art", "framed art", "framed picture", "photo frame", "photograph", "print", "canvas", "wall hanging", "tapestry", "framed photo", "whiteboard", "blackboard", "chalkboard", "bulletin board", "cork board", "pin board", "calendar", "art print", "map", "wall decor", "wall decoration", "wall sign", "sign", "wall panel", "framed poster", "frame"]),
    row("mirror", Level::Wall, [0.7, 0.95, 0.03], [0.12, 0.12, 0.005], [2.5, 2.4, 0.12], MaterialCategory::Glass, "fp", None, &["wall mirror", "floor mirror", "round mirror", "standing mirror", "vanity mirror", "full-length mirror"]),
    row("clock", Level::Wall, [0.32, 0.32, 0.05], [0.06, 0.06, 0.02], [0.9, 0.9, 0.15], MaterialCategory::Plastic, "fp", None, &["wall clock", "alarm clock", "table clock"]),
    row("tv", Level::Decoration, [1.2, 0.75, 0.22], [0.4, 0.25, 0.02], [2.2, 1.3, 0.45], MaterialCategory::Plastic, "f", None, &["television", "flat screen", "flat-screen tv", "wall mounted tv", "tv screen", "screen", "projector screen", "wall tv", "smart tv", "wall-mounted tv"]),
    row("monitor", Level::Decoration, [0.6, 0.45, 0.2], [0.3, 0.25, 0.1], [1.3, 0.7, 0.35], MaterialCategory::Plastic, "f", None, &["computer monitor", "computer screen", "display", "desktop computer", "imac", "computer"]),
    row("laptop", Level::Decoration, [0.34, 0.24, 0.3], [0.25, 0.012, 0.18], [0.45, 0.35, 0.42], MaterialCategory::Metal, "fb", None, &["notebook computer", "macbook", "tablet", "laptop computer"]),
    row("keyboard", Level::Decoration, [0.42, 0.025, 0.14], [0.25, 0.01, 0.08], [0.55, 0.06, 0.25], MaterialCategory::Plastic, "f", None, &["computer keyboard", "remote", "remote control", "phone", "mobile phone", "telephone", "game controller"]),
    row("speaker", Level::Decoration, [0.2, 0.32, 0.24], [0.06, 0.06, 0.06], [0.6, 1.4, 0.6], MaterialCategory::Wood, "f", None, &["loudspeaker", "soundbar", "subwoofer", "sound bar", "stereo", "radio", "amplifier", "hifi", "printer", "game console", "router"]),
    row("fan", Level::Furniture, [0.42, 1.1, 0.4], [0.15, 0.2, 0.12], [0.6, 1.5, 0.6], MaterialCategory::Plastic, "f", None, &["standing fan", "pedestal fan", "desk fan", "table fan", "electric fan", "floor fan"]),
    row("cushion", Level::Decoration, [0.46, 0.44, 0.17], [0.15, 0.12, 0.05], [1.0, 0.8, 0.45], MaterialCategory::Fabric, "f", None, &["pillow", "throw pillow", "throw cushion", "scatter cushion", "bolster", "bed pillow", "seat cushion", "decorative pillow"]),
    row("blanket", Level::Decoration, [0.5, 0.1, 0.4], [0.15, 0.02, 0.1], [2.2, 0.5, 2.0], MaterialCategory::Fabric, "s", None, &["throw", "throw blanket", "quilt", "bedspread", "duvet", "comforter", "plaid", "coverlet", "bedding", "folded blanket", "clothes", "clothing", "laundry", "coat", "jacket", "bed runner", "tablecloth", "table runner"]),
    row("towel", Level::Wall, [0.5, 0.7, 0.1], [0.15, 0.2, 0.02], [1.0, 1.4, 0.2], MaterialCategory::Fabric, "f", None, &["bath towel", "hand towel", "towel rack", "towel rail", "towels"]),
    row("book", Level::Decoration, [0.16, 0.03, 0.23], [0.08, 0.005, 0.1], [0.4, 0.1, 0.45], MaterialCategory::Paper, "s", None, &["magazine", "notebook", "notepad", "album", "journal", "newspaper", "folder", "paper", "papers", "document", "tray", "cutting board", "placemat", "game board"]),
    row("book_stack", Level::Decoration, [0.24, 0.14, 0.3], [0.08, 0.04, 0.1], [1.2, 0.5, 0.45], MaterialCategory::Paper, "s", None, &["books", "stack of books", "pile of books", "book pile", "magazines", "row of books", "books stack", "binders", "file folders"]),
    row("vase", Level::Decoration, [0.16, 0.3, 0.16], [0.04, 0.06, 0.04], [0.6, 1.2, 0.6], MaterialCategory::Ceramic, "", None, &["urn", "jug", "pitcher", "flower vase", "jar", "pot", "carafe", "pottery", "ceramic vase", "canister", "vessel", "amphora"]),
    row("flowers", Level::Decoration, [0.3, 0.45, 0.3], [0.1, 0.15, 0.1], [0.9, 1.3, 0.9], MaterialCategory::Ceramic, "", None, &["vase with flowers", "bouquet", "flower arrangement", "flowers in vase", "flower", "floral arrangement", "vase of flowers", "dried flowers", "branches", "pampas grass"]),
    row("bottle", Level::Decoration, [0.08, 0.29, 0.08], [0.03, 0.08, 0.03], [0.2, 0.5, 0.2], MaterialCategory::Glass, "", None, &["wine bottle", "water bottle", "soap dispenser", "perfume", "lotion", "spray bottle", "soap bottle", "decanter", "bottles", "thermos"]),
    row("bowl", Level::Decoration, [0.26, 0.1, 0.26], [0.08, 0.03, 0.08], [0.6, 0.35, 0.6], MaterialCategory::Ceramic, "s", None, &["fruit bowl", "dish", "salad bowl", "bowl of fruit", "serving bowl", "fruit", "centerpiece"]),
    row("plate", Level::Decoration, [0.26, 0.025, 0.26], [0.1, 0.01, 0.1], [0.5, 0.08, 0.5], MaterialCategory::Ceramic, "s", None, &["platter", "saucer", "dinner plate", "ashtray", "coaster", "plates", "pan"]),
    row("cup", Level::Decoration, [0.12, 0.1, 0.085], [0.04, 0.04, 0.04], [0.2, 0.25, 0.2], MaterialCategory::Ceramic, "", None, &["mug", "glass", "wine glass", "tea cup", "coffee mug", "tumbler", "coffee cup", "drinking glass", "pen holder", "pencil cup", "pencil holder", "wine glasses", "glasses", "teacup", "goblet"]),
    row("kettle", Level::Decoration, [0.24, 0.24, 0.18], [0.12, 0.12, 0.1], [0.4, 0.45, 0.35], MaterialCategory::Metal, "", None, &["teapot", "coffee maker", "coffee machine", "electric kettle", "blender", "mixer", "coffee pot", "watering can", "pot with lid", "cooking pot"]),
    row("box", Level::Decoration, [0.35, 0.25, 0.28], [0.04, 0.02, 0.04], [1.5, 1.2, 1.2], MaterialCategory::Paper, "s", None, &["carton", "cardboard box", "storage box", "crate", "gift box", "package", "container", "tissue box", "case", "bin box", "jewelry box", "chest box", "organizer", "tissue", "wooden box"]),
    row("basket", Level::Decoration, [0.36, 0.32, 0.36], [0.1, 0.08, 0.1], [0.9, 0.8, 0.9], MaterialCategory::Rattan, "", None, &["wicker basket", "laundry basket", "hamper", "woven basket", "laundry hamper", "bucket", "planter basket"]),
    row("trash_bin", Level::Furniture, [0.3, 0.4, 0.3], [0.15, 0.2, 0.15], [0.6, 1.0, 0.6], MaterialCategory::Metal, "", None, &["trash can", "bin", "waste bin", "wastebasket", "garbage can", "rubbish bin", "waste basket", "dustbin", "recycling bin", "umbrella stand"]),
    row("plant", Level::Furniture, [0.6, 1.1, 0.6], [0.08, 0.1, 0.08], [1.8, 2.6, 1.8], MaterialCategory::Other, "", None, &["potted plant", "houseplant", "house plant", "indoor plant", "tree", "palm", "fern", "succulent", "cactus", "ficus", "snake plant", "fiddle leaf fig", "olive tree", "monstera", "planter", "bonsai", "flower pot", "hanging plant", "ivy", "flowerpot", "christmas tree", "greenery", "orchid", "aloe", "areca palm", "pothos", "bush"]),
    row("candle", Level::Decoration, [0.08, 0.13, 0.08], [0.02, 0.02, 0.02], [0.25, 0.6, 0.25], MaterialCategory::Other, "", None, &["candles", "candlestick", "candle holder", "tea light", "tealight", "candleholder", "diffuser"]),
    row("teddy_bear", Level::Decoration, [0.28, 0.34, 0.26], [0.08, 0.08, 0.06], [0.9, 1.1, 0.8], MaterialCategory::Fabric, "f", None, &["stuffed animal", "plush", "plush toy", "soft toy", "doll", "toy", "stuffed toy", "teddy"]),
    row("figurine", Level::Decoration, [0.14, 0.3, 0.14], [0.03, 0.05, 0.03], [0.7, 1.8, 0.7], MaterialCategory::Ceramic, "f", None, &["sculpture", "statue", "statuette", "bust", "ornament", "trophy", "globe", "decor", "decoration", "decorative object", "buddha", "decorative item", "vase sculpture", "art object", "knick-knack"]),
    row("suitcase", Level::Furniture, [0.45, 0.65, 0.28], [0.2, 0.2, 0.12], [0.8, 0.95, 0.5], MaterialCategory::Plastic, "f", None, &["luggage", "bag", "backpack", "handbag", "briefcase", "duffel bag", "tote bag", "shopping bag", "purse"]),
    row("guitar", Level::Furniture, [0.38, 1.02, 0.12], [0.25, 0.7, 0.08], [0.5, 1.3, 0.3], MaterialCategory::Wood, "f", None, &["acoustic guitar", "electric guitar", "violin", "cello", "bass", "ukulele"]),
    row("coat_rack", Level::Furniture, [0.45, 1.75, 0.45], [0.2, 0.1, 0.05], [1.2, 2.0, 0.8], MaterialCategory::Wood, "", None, &["coat stand", "hat stand", "coat hooks", "hooks", "hook rail", "clothes rack", "garment rack", "hanger", "clothes stand", "wall hooks", "towel hook"]),
    row("fireplace", Level::Furniture, [1.4, 1.1, 0.4], [0.7, 0.6, 0.15], [2.6, 2.7, 0.9], MaterialCategory::Stone, "fs", None, &["mantel", "mantelpiece", "chimney", "electric fireplace", "wood stove", "hearth"]),
    row("radiator", Level::Wall, [0.9, 0.6, 0.12], [0.3, 0.2, 0.05], [2.5, 2.0, 0.3], MaterialCategory::Metal, "f", None, &["heater", "convector", "baseboard heater", "space heater"]),
    row("air_conditioner", Level::Wall, [0.85, 0.3, 0.22], [0.5, 0.2, 0.12], [1.3, 0.5, 0.4], MaterialCategory::Plastic, "f", None, &["ac unit", "ac", "split unit", "aircon", "air purifier", "air conditioning", "air conditioning unit"]),
    row("wall_plate", Level::Wall, [0.09, 0.09, 0.012], [0.03, 0.03, 0.003], [0.7, 0.7, 0.1], MaterialCategory::Plastic, "f", None, &["switch", "light switch", "socket", "outlet", "power outlet", "thermostat", "vent", "air vent", "intercom", "wall outlet"]),
    row("toilet", Level::Furniture, [0.38, 0.78, 0.68], [0.3, 0.35, 0.45], [0.5, 1.0, 0.85], MaterialCategory::Ceramic, "fb", None, &["wc", "bidet", "lavatory", "toilet bowl"]),
    row("bathtub", Level::Furniture, [1.7, 0.6, 0.78], [1.1, 0.4, 0.6], [2.1, 0.9, 1.1], MaterialCategory::Ceramic, "", None, &["bath", "tub", "shower tray", "jacuzzi", "bath tub"]),
    row("sink", Level::Furniture, [0.8, 0.95, 0.5], [0.3, 0.15, 0.25], [2.2, 1.2, 0.75], MaterialCategory::Ceramic, "f", None, &["vanity", "washbasin", "wash basin", "bathroom vanity", "basin", "bathroom sink", "pedestal sink", "vanity unit", "vanity cabinet", "kitchen sink"]),
];

/// One row; `flags`: `f` has a front, `b` a high back, `c` a closed one, `p` planar, `s` supports other things.
#[expect(clippy::too_many_arguments, reason = "columns of a table")]
const fn row(
    name: &'static str,
    level: Level,
    size: [f64; 3],
    min: [f64; 3],
    max: [f64; 3],
    material: MaterialCategory,
    flags: &'static str,
    light: Option<&'static str>,
    synonyms: &'static [&'static str],
) -> Category {
    let (front, planar, supports) = (has(flags, b'f'), has(flags, b'p'), has(flags, b's'));
    let back = if has(flags, b'b') {
        Some(Back::High)
    } else if has(flags, b'c') {
        Some(Back::Closed)
    } else {
        None
    };
    Category { name, level, size, min, max, material, front, back, planar, light, supports, synonyms }
}

const fn has(flags: &str, flag: u8) -> bool {
    let bytes = flags.as_bytes();
    let mut k = 0;
    while k < bytes.len() {
        if bytes[k] == flag {
            return true;
        }
        k += 1;
    }
    false
}
