//! The table of kinds: what each is, whether it is held out, its shape, and its materials, one of which is drawn.
//!
//! A kind's place names its random stream, so new kinds come last.

use settings::words;

use super::blocks::Part;
use super::kinds::Draw;
use super::{kinds, tools, toys, vessels};

words! {
    /// Which kinds are drawn.
    pub enum Split {
        /// Those that networks learn from.
        Train = "train",
        /// Those that are kept for tests: no shipped config draws them.
        HeldOut = "held-out",
    }
}

/// What an object is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Material {
    pub(super) name: &'static str,
    /// Mass of the parts by their volume; of a full or an empty body, on average.
    pub(super) density_kg_m3: f32,
    /// Coulomb friction coefficient, uniform.
    pub(super) friction: [f32; 2],
}

const fn material(name: &'static str, density_kg_m3: f32, friction: [f32; 2]) -> Material {
    Material { name, density_kg_m3, friction }
}

const CERAMIC: Material = material("ceramic", 2300.0, [0.6, 0.8]);
const GLASS: Material = material("glass", 2500.0, [0.5, 0.7]);
const PLASTIC: Material = material("plastic", 1050.0, [0.6, 0.9]);
const STEEL: Material = material("steel", 7800.0, [0.5, 0.7]);
const ALUMINIUM: Material = material("aluminium", 2700.0, [0.5, 0.7]);
const WOOD: Material = material("wood", 650.0, [0.7, 0.9]);
const RUBBER: Material = material("rubber", 1150.0, [0.9, 1.2]);
const STONE: Material = material("stone", 2400.0, [0.7, 0.9]);
const FRUIT: Material = material("fruit", 950.0, [0.7, 1.0]);
const CARD: Material = material("card, full", 400.0, [0.7, 0.9]);
const LIGHT: Material = material("card, airy inside", 150.0, [0.7, 0.9]);
const PAPER: Material = material("paper", 750.0, [0.5, 0.8]);
const FULL: Material = material("plastic, full", 950.0, [0.6, 0.8]);
const EMPTY: Material = material("glass, empty", 250.0, [0.6, 0.8]);

/// Draws the convex parts of an object of a kind.
type Shaper = fn(&mut Draw) -> Vec<Part>;

macro_rules! kinds {
    ($($(#[doc = $doc:literal])* $kind:ident = $name:literal, $split:ident, $shape:path, [$($material:ident),*];)*) => {
        words! {
            /// A kind of household objects.
            pub enum Kind {
                $($(#[doc = $doc])* $kind = $name),*
            }
        }

        impl Kind {
            /// Train or held-out; how its parts are drawn; its materials.
            pub(super) fn recipe(self) -> (Split, Shaper, &'static [Material]) {
                match self {
                    $(Self::$kind => (Split::$split, $shape, &[$($material),*])),*
                }
            }
        }
    };
}

kinds! {
    /// A tumbler, wider at the top.
    Cup = "cup", Train, kinds::cup, [PLASTIC, CERAMIC, GLASS];
    /// A round bowl.
    Bowl = "bowl", Train, kinds::bowl, [CERAMIC, PLASTIC, WOOD];
    /// A full bottle with a cap, round or rather square.
    Bottle = "bottle", Train, kinds::bottle, [FULL, EMPTY];
    /// A full jar with a lid.
    Jar = "jar", Train, kinds::jar, [FULL, EMPTY];
    /// A thin, flat dish.
    Saucer = "saucer", Train, kinds::saucer, [CERAMIC, PLASTIC];
    /// A small pan with a handle.
    Pan = "pan", Train, kinds::pan, [ALUMINIUM, CERAMIC];
    /// A ladle with a rising handle.
    Ladle = "ladle", Train, kinds::ladle, [PLASTIC, WOOD, ALUMINIUM];
    /// A bent bar, like a pipe's elbow.
    Elbow = "elbow", Train, kinds::elbow, [PLASTIC, RUBBER, WOOD];
    /// A box with a lid that stands over.
    Carton = "carton", Train, kinds::carton, [CARD, WOOD];
    /// An open box.
    Crate = "crate", Train, kinds::open_box, [WOOD, PLASTIC];
    /// A superellipsoid, between a ball, a block and a coin.
    Pebble = "pebble", Train, kinds::pebble, [STONE, RUBBER, WOOD];
    /// A screwdriver.
    Screwdriver = "screwdriver", Train, kinds::screwdriver, [PLASTIC, STEEL];
    /// A brush with a block of bristles.
    Brush = "brush", Train, kinds::brush, [WOOD, PLASTIC];
    /// A banana.
    Banana = "banana", Train, kinds::banana, [FRUIT];
    /// A funnel, open at both ends.
    Funnel = "funnel", Train, kinds::funnel, [PLASTIC, ALUMINIUM];
    /// A spool with two flanges.
    Spool = "spool", Train, kinds::spool, [WOOD, PLASTIC];
    /// A goblet on a thin stem.
    Goblet = "goblet", Train, kinds::goblet, [GLASS, WOOD];
    /// A board with a tab.
    Board = "board", Train, kinds::board, [WOOD, PLASTIC];
    /// A mug with a handle.
    Mug = "mug", HeldOut, kinds::mug, [CERAMIC, PLASTIC];
    /// A light bulb.
    Bulb = "bulb", HeldOut, kinds::bulb, [EMPTY];
    /// A ring, thin or thick.
    Ring = "ring", HeldOut, kinds::ring, [RUBBER, WOOD, ALUMINIUM];
    /// A profile like an L, a T or a U.
    Bracket = "bracket", HeldOut, kinds::bracket, [ALUMINIUM, STEEL, PLASTIC];
    /// A boot with a hollow shaft.
    Boot = "boot", HeldOut, kinds::boot, [RUBBER, EMPTY];
    /// A hammer.
    Hammer = "hammer", HeldOut, kinds::hammer, [WOOD, RUBBER, ALUMINIUM];
    /// A knob with three to five arms on a stem.
    Knob = "knob", HeldOut, kinds::knob, [PLASTIC, ALUMINIUM];
    /// A basket with a bow.
    Basket = "basket", HeldOut, kinds::basket, [WOOD, PLASTIC];
    /// An open spanner with an eye at its other end.
    Wrench = "wrench", HeldOut, kinds::wrench, [STEEL, ALUMINIUM];
    /// A tray with a low, sloping wall.
    Tray = "tray", Train, vessels::tray, [PLASTIC, WOOD, ALUMINIUM];
    /// A lampshade, open at both ends.
    Lampshade = "lampshade", Train, vessels::lampshade, [PLASTIC, LIGHT];
    /// A cup that is fixed to its saucer.
    Teacup = "teacup", Train, vessels::teacup, [CERAMIC, PLASTIC];
    /// A closed kettle with a spout and a bow.
    Kettle = "kettle", Train, vessels::kettle, [FULL, EMPTY];
    /// A flat iron with a grip above.
    Iron = "iron", Train, tools::iron, [PLASTIC, ALUMINIUM];
    /// A small suitcase.
    Suitcase = "suitcase", Train, vessels::suitcase, [LIGHT, CARD];
    /// A watering can with a long spout and an angular handle.
    WateringCan = "watering_can", Train, vessels::watering_can, [PLASTIC, ALUMINIUM];
    /// A spatula with a rising handle.
    Spatula = "spatula", Train, tools::spatula, [PLASTIC, WOOD, STEEL];
    /// A whisk of six wires.
    Whisk = "whisk", Train, tools::whisk, [PLASTIC, STEEL];
    /// A rolling pin.
    RollingPin = "rolling_pin", Train, tools::rolling_pin, [WOOD, PLASTIC];
    /// Open pliers.
    Pliers = "pliers", Train, tools::pliers, [STEEL, PLASTIC];
    /// A large plate with a rim.
    Plate = "plate", Train, vessels::plate, [CERAMIC, PLASTIC, WOOD];
    /// A closed book whose cover stands over.
    Book = "book", Train, tools::book, [PAPER];
    /// A flat telephone.
    Phone = "phone", Train, tools::phone, [GLASS, PLASTIC];
    /// A ruler.
    Ruler = "ruler", Train, tools::ruler, [PLASTIC, WOOD, ALUMINIUM];
    /// A tall box.
    Cereal = "cereal", Train, vessels::cereal, [LIGHT];
    /// A full packet with soft edges.
    Packet = "packet", Train, vessels::packet, [LIGHT, FULL, PAPER];
    /// A can.
    Can = "can", Train, vessels::can, [FULL, EMPTY];
    /// An egg.
    Egg = "egg", Train, toys::egg, [FRUIT, WOOD, STONE];
    /// A carrot with the rest of its leaves.
    Carrot = "carrot", Train, toys::carrot, [FRUIT];
    /// A dumb-bell with six-sided heads.
    Dumbbell = "dumbbell", Train, tools::dumbbell, [RUBBER, ALUMINIUM, PLASTIC];
    /// A spur gear with a hub.
    Gear = "gear", Train, tools::gear, [ALUMINIUM, PLASTIC, STEEL];
    /// A T-piece of a pipe with flanges.
    Tee = "tee", Train, tools::tee, [PLASTIC, ALUMINIUM];
    /// A door stop.
    Wedge = "wedge", Train, tools::wedge, [WOOD, RUBBER, PLASTIC];
    /// A flat star with five or six points.
    Star = "star", Train, toys::star, [WOOD, PLASTIC];
    /// A chair with a back.
    Chair = "chair", Train, toys::chair, [WOOD, PLASTIC];
    /// A chess pawn.
    Pawn = "pawn", Train, toys::pawn, [WOOD, PLASTIC];
    /// A toy car with four wheels.
    Car = "car", Train, toys::car, [WOOD, PLASTIC];
    /// A pot's lid with a knob.
    Lid = "lid", HeldOut, vessels::lid, [GLASS, ALUMINIUM, CERAMIC];
    /// A hand bell.
    Bell = "bell", HeldOut, vessels::bell, [ALUMINIUM, CERAMIC, STEEL];
    /// A bellied jug with an ear.
    Jug = "jug", HeldOut, vessels::jug, [CERAMIC, PLASTIC, GLASS];
    /// A ball weight with a grip.
    Kettlebell = "kettlebell", HeldOut, tools::kettlebell, [ALUMINIUM, RUBBER, PLASTIC];
    /// Tongs of one bent strip.
    Tongs = "tongs", HeldOut, tools::tongs, [PLASTIC, WOOD, ALUMINIUM];
    /// A large key.
    Key = "key", HeldOut, tools::key, [STEEL, ALUMINIUM];
    /// A comb with coarse teeth.
    Comb = "comb", HeldOut, tools::comb, [PLASTIC, WOOD];
    /// A horseshoe.
    Horseshoe = "horseshoe", HeldOut, tools::horseshoe, [STEEL, ALUMINIUM, PLASTIC];
    /// A carton with a gable.
    MilkCarton = "milk_carton", HeldOut, vessels::milk_carton, [CARD, FULL];
    /// A box with rounded edges and a well in its top.
    TissueBox = "tissue_box", HeldOut, vessels::tissue_box, [CARD, LIGHT];
    /// A pear with its stem.
    Pear = "pear", HeldOut, toys::pear, [FRUIT, WOOD];
    /// A toy brick like an arch.
    Arch = "arch", HeldOut, toys::arch, [WOOD, PLASTIC, STONE];
    /// A toy brick with studs.
    Brick = "brick", HeldOut, toys::brick, [PLASTIC];
    /// A stool with three or four splayed legs.
    Stool = "stool", HeldOut, toys::stool, [WOOD, PLASTIC];
}

impl Kind {
    /// Whether it is kept for tests.
    #[must_use]
    pub(crate) fn is_held_out(self) -> bool {
        self.recipe().0 == Split::HeldOut
    }
}
